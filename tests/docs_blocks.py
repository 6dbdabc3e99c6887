"""What the pages of the documentation ask a reader to type: read from their fenced blocks."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

_FENCE = re.compile(r"^(?P<ticks>`{3,})(?P<language>[^`\s]*)[^`]*$")
_FILE_NAME = re.compile(r"^(?:#|//|<!--)\s*(?P<name>[\w./-]+\.[a-z]+)\s*(?:-->)?$")
_PROGRAMS = re.compile(r"^(?:\.venv/bin/)?(?:coheft|make|python|pip)\s")
_SHELL = ("sh", "bash", "shell")
_SCRIPT = re.compile(r"<<|^for |^while ", re.MULTILINE)
_NUMBER = re.compile(r"[-+−]?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?")


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, its lines, and the number of its first line on the page."""

    language: str
    lines: tuple[str, ...]
    number: int

    @property
    def file_name(self) -> str | None:
        """The file that the reader is to write it into: it is named in a comment that is the first line."""
        match = _FILE_NAME.match(self.lines[0]) if self.lines else None
        return match["name"] if match and self.language not in ("", "console", *_SHELL) else None

    @property
    def text(self) -> str:
        """All its lines."""
        return "\n".join(self.lines) + "\n"


@dataclass
class Command:
    """A command, in the words of ``normal``, and what the page says that it prints."""

    text: str
    number: int
    output: list[str] = field(default_factory=list)

    @property
    def name(self) -> str:
        """By which it is looked up: itself, or the first line of a script."""
        return self.text.partition("\n")[0]


def blocks(page: Path) -> Iterator[Block]:
    """All fenced blocks of a page, in order; fences may be indented, as in lists."""
    opened: tuple[str, str, int, int] | None = None
    lines: list[str] = []
    for number, line in enumerate(page.read_text().splitlines(), 1):
        stripped = line.strip()
        if opened is None:
            if match := _FENCE.match(stripped):
                opened = (match["ticks"], match["language"], number + 1, len(line) - len(line.lstrip()))
                lines = []
        elif stripped == opened[0]:
            yield Block(opened[1], tuple(lines), opened[2])
            opened = None
        else:
            lines.append(line[min(opened[3], len(line) - len(line.lstrip())) :])
    assert opened is None, f"{page}: the block that begins in line {opened[2]} has no end"


def commands(block: Block) -> list[Command]:
    """The commands of a block.

    In a block of the language ``sh``, ``bash`` or ``shell`` every line is one; in others, ``console`` among them, those
    behind ``$``, and what follows is their output. Without language, and without ``$``, lines that begin with the name
    of a program that coheft's users know. A block with here-documents or loops is a script: one command of many lines.
    """
    if block.language not in ("", "console", *_SHELL):
        return []
    if block.language != "console" and _SCRIPT.search(block.text):
        return [Command(block.text.strip(), block.number)]
    lines = list(_joined(block))
    if any(line.startswith("$ ") for line, _ in lines):
        found: list[Command] = []
        for line, number in lines:
            if line.startswith("$ "):
                found.append(Command(normal(line[2:]), number))
            elif found:
                found[-1].output.append(line)
        return found
    if block.language == "console":
        return []
    if block.language == "":
        lines = [(line, number) for line, number in lines if _PROGRAMS.match(f"{line} ")]
    return [Command(text, number) for line, number in lines if (text := normal(line))]


def _joined(block: Block) -> Iterator[tuple[str, int]]:
    """Lines with their numbers; those that end with a backslash joined with the next."""
    begun, start = "", 0
    for number, line in enumerate(block.lines, block.number):
        start = start if begun else number
        if line.endswith("\\"):
            begun += line[:-1]
        else:
            yield begun + line, start
            begun = ""


def normal(line: str) -> str:
    """A command without its comment and superfluous spaces, and without the folder of the program."""
    lexer = shlex.shlex(line, posix=False)
    lexer.whitespace_split, lexer.commenters = True, "#"
    words = list(lexer)
    return " ".join([words[0].removeprefix(".venv/bin/"), *words[1:]]) if words else ""


def missing_line(shown: Sequence[str], printed: str) -> str | None:
    """The first line of an excerpt that has no counterpart in what a command printed, in this order; None if none.

    Numbers may differ, and so may the number of spaces; ``…`` stands for anything.
    """
    rest = iter([_shape(line) for line in printed.splitlines()])
    for line in shown:
        pattern = re.escape(_shape(line)).replace("…", ".*")
        if pattern in ("", ".*"):
            continue
        if not any(re.fullmatch(pattern, candidate) for candidate in rest):
            return line
    return None


def _shape(line: str) -> str:
    return " ".join(_NUMBER.sub("0", line).split())

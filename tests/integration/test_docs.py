"""The documentation is true: every command and every Python snippet of all pages is run, in order, as a reader would.

A page is worked through in a folder of its own, which looks like a clone of the repository as far as pages need it.
Blocks whose first line is a comment with nothing but a file's name are written into that file. What cannot be run as it
stands is in ``docs_commands.toml``, with the reason. ``tests/docs_blocks.py`` tells which lines count as commands.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from tests.docs_blocks import Block, Command, blocks, commands, missing_line, normal

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")])
TABLE_FILE = Path(__file__).with_name("docs_commands.toml")
PATIENCE = 1200.0
STOPPED = (0, 3, 130)  # a run that is stopped tells how far it had got
PLUGINS = ".venv/plugins"  # what pages install is seen by them only
COPIED = ("configs", "docs", "examples")

pytestmark = [pytest.mark.skipif(os.name != "posix", reason="commands of a POSIX shell")]


class Way(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename={"is_": "is"}):
    """How a command is run that is not run as it stands; see the top of ``docs_commands.toml``."""

    is_: str
    why: str
    page: str = ""
    run: str = ""
    skip: bool = False
    run_on: str = ""
    exit: int = 0
    beside: str = ""
    until: str = ""
    background: bool = False
    alike: bool = False
    patient: bool = False


class Replacement(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is written otherwise in the files of a page."""

    page: str
    old: str
    new: str


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All of ``docs_commands.toml``."""

    command: list[Way]
    replace: list[Replacement] = []


TABLE = msgspec.convert(tomllib.loads(TABLE_FILE.read_text()), Table)
WAYS = {(way.page, normal(way.is_)): way for way in TABLE.command}


def way_of(page: Path, name: str) -> Way:
    """How a command of a page is run; as it stands if the table does not say otherwise."""
    return WAYS.get((page.name, name)) or WAYS.get(("", name)) or Way(name, "")


def same_on_other_pages(page: Path, name: str) -> Iterator[tuple[Path, Command]]:
    """The same command where other pages show it, if it is run on this page for them."""
    for other in PAGES:
        if way_of(other, name).run_on == page.name:
            yield from ((other, each) for block in blocks(other) for each in commands(block) if each.name == name)


class Reader:
    """Somebody who does what a page says."""

    def __init__(self, page: Path, folder: Path) -> None:
        self.page, self.folder = page, folder / "clone"
        self.beside: dict[str, subprocess.Popen[bytes]] = {}
        for name in COPIED:
            if (ROOT / name).is_dir():
                shutil.copytree(ROOT / name, self.folder / name)
        programs = self.folder / ".venv" / "bin"
        programs.mkdir(parents=True)
        for name, command in {
            "python": f"'{sys.executable}'",
            "pip": f"'{sys.executable}' -m pip",
            "coheft": f"'{sys.executable}' -m coheft",
            "make": f"'{shutil.which('make')}' -C '{ROOT}' -o .venv/installed -o .venv/runtime BIN='{programs}'",
        }.items():
            program = programs / name
            program.write_text(f'#!/bin/sh\nexec {command} "$@"\n')
            program.chmod(0o755)
        (programs / "activate").write_text("# the PATH is as it should be\n")
        self.environment = {
            **os.environ,
            "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}",
            "PYTHONPATH": os.pathsep.join(
                [str(ROOT), str(self.folder / PLUGINS), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
            ),
            "XDG_STATE_HOME": str(folder / "state"),  # runs that others have started are not found
            "COLUMNS": "80",
        }

    def work_through(self) -> None:
        """Do all that the page says, in order."""
        shown = {command.name for block in blocks(self.page) for command in commands(block) if command.output}
        for block in blocks(self.page):
            if block.file_name is not None:
                self._write(block)
            elif block.language == "python":
                self._run_snippet(block)
            for command in commands(block):
                if command.output or command.name not in shown:  # else once is enough: where the page shows its output
                    self._carry_out(command)

    def _write(self, block: Block) -> None:
        text = block.text
        for replacement in TABLE.replace:
            if replacement.page == self.page.name:
                text = text.replace(replacement.old, replacement.new)
        path = self.folder / str(block.file_name)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)

    def _run_snippet(self, block: Block) -> None:
        if not way_of(self.page, normal(block.lines[0])).skip:
            script = self.folder / f"snippet{block.number}.py"
            script.write_text(block.text)
            self._run(f"python {script.name}", block.number, Way("", ""))

    def _carry_out(self, command: Command) -> None:
        found = way_of(self.page, command.name)
        if found.skip or found.run_on:
            return
        if found.beside and found.beside not in self.beside:
            self._start_beside(found.beside)
        text = found.run or command.text
        if found.background:
            process, output = self._start(text, f"line{command.number}")
            self.beside[text] = process
            if found.until:
                self._wait_for(found.until, process, output, text)
            return
        printed = self._run(text, command.number, found)
        if not found.run or found.alike:
            for page, each in [(self.page, command), *same_on_other_pages(self.page, command.name)]:
                lost = missing_line(each.output, printed)
                place = f"{page.name}, line {each.number}"
                assert lost is None, f"{place}: {text} no longer prints\n{lost}\nbut\n{printed}"

    def _start(self, text: str, name: str) -> tuple[subprocess.Popen[bytes], Path]:
        output = self.folder.with_name(f"{name}.out")
        with output.open("wb") as file:
            process = subprocess.Popen(
                ["bash", "-e", "-c", text], cwd=self.folder, env=self.environment, stdin=subprocess.DEVNULL,
                stdout=file, stderr=subprocess.STDOUT, start_new_session=True,
            )  # fmt: skip
        return process, output

    def _start_beside(self, text: str) -> None:
        process, output = self._start(text, f"beside{len(self.beside)}")
        self.beside[text] = process
        self._wait_for("", process, output, text)

    def _wait_for(self, text: str, process: subprocess.Popen[bytes], output: Path, command: str) -> None:
        """Wait until it has printed that, or anything; it may not end before."""
        deadline = time.monotonic() + PATIENCE
        while not (printed := output.read_text()) or text not in printed:
            assert process.poll() is None, f"{self.page.name}: {command} ended:\n{printed}"
            assert time.monotonic() < deadline, f"{self.page.name}: {command} has not printed {text!r}:\n{printed}"
            time.sleep(0.1)

    def _run(self, text: str, number: int, how: Way) -> str:
        """What it prints; its exit status is as expected."""
        deadline = time.monotonic() + PATIENCE
        expected = STOPPED if how.until else (how.exit,)
        while True:
            status, printed = self._run_once(text, number, how.until)
            if status in expected and how.until in printed:
                return printed
            missing = "" if how.until in printed else f" and has not printed {how.until!r}"
            what = f"{self._place(number)}: {text} ended with exit status {status}{missing}:\n{printed}"
            assert how.patient, what
            assert time.monotonic() < deadline, what
            time.sleep(0.5)

    def _run_once(self, text: str, number: int, until: str) -> tuple[int, str]:
        """Exit status, and what it printed."""
        process, output = self._start(text, f"line{number}")
        deadline = time.monotonic() + PATIENCE
        try:
            while until and process.poll() is None and time.monotonic() < deadline:
                if until in output.read_text():
                    os.killpg(process.pid, signal.SIGINT)
                    break
                time.sleep(0.1)
            return process.wait(PATIENCE), output.read_text()
        finally:
            _kill(process)

    def _place(self, number: int) -> str:
        return f"{self.page.name}, line {number}"

    def leave(self) -> None:
        """Stop what still runs."""
        for process in self.beside.values():
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGINT)
        for text, process in self.beside.items():
            try:
                status = process.wait(PATIENCE)
            finally:
                _kill(process)
            assert status in STOPPED, f"{self.page.name}: {text} ended with exit status {status}"


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Leave nothing of its group."""
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        return
    process.wait()


@pytest.fixture
def reader(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Reader]:
    someone = Reader(request.param, tmp_path)
    yield someone
    someone.leave()


@pytest.mark.timeout(1800)
@pytest.mark.parametrize("reader", PAGES, ids=lambda page: page.name, indirect=True)
def test_a_reader_can_do_what_the_page_says(reader: Reader) -> None:
    reader.work_through()


def test_the_table_is_about_what_pages_say() -> None:
    said = {(page.name, command.name) for page in PAGES for block in blocks(page) for command in commands(block)}
    said |= {
        (page.name, normal(block.lines[0])) for page in PAGES for block in blocks(page) if block.language == "python"
    }
    unsaid = sorted(set(WAYS) - said - {("", name) for _, name in said})
    assert not unsaid, f"{TABLE_FILE.name} is about commands that no page has"
    assert all(way.why for way in TABLE.command), "all of it needs a reason"
    for way in TABLE.command:
        if way.run_on:
            there = WAYS.get((way.run_on, normal(way.is_)), Way(way.is_, ""))
            assert (way.run_on, normal(way.is_)) in said, "another page cannot run what it does not say"
            assert not there.skip, "where it is run"
            assert there.alike or not there.run, "where its output is compared"
    files = {page.name: page.read_text() for page in PAGES}
    assert all(replacement.old in files[replacement.page] for replacement in TABLE.replace)


def test_links_lead_somewhere() -> None:
    """Of pages that are not part of the site; of those that are, Sphinx says so."""
    for page in (ROOT / "README.md", ROOT / "CONTRIBUTING.md"):
        targets: list[Any] = re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text())
        missing = [target for target in targets if not (page.parent / target).exists()]
        assert not missing, f"{page.name} links to {', '.join(missing)}"

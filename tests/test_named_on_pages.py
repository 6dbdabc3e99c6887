"""What pages name inside sentences, tables and blocks that are not run exists: commands, options, modules."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from coheft.agents.efficient.estimator import NO_LOAD_AT_POSES
from coheft.agents.efficient.judge import Outcome
from coheft.app.cli.main import app
from tests.docs_blocks import blocks, commands

ROOT = Path(__file__).parents[1]
PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")])
INLINE = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")
COMMAND = re.compile(r"(?:^|\$ |bin/)coheft ((?:cart )?[a-z][a-z0-9-]*)((?: [^#|&]*)?)")
OPTION = re.compile(r"(?<![\w-])(--[a-z][a-z-]*)")
MODULE = re.compile(r"(?<![\w/.-])([a-z][a-z0-9_/]*\.py)\b")
GENERAL = {"--help", "--version"}
FOREIGN = {"--spec", "--ros-args", "--effort", "--teams", "--against"}
"""Options of other programs that pages name by themselves."""


def _options(name: str) -> set[str]:
    first, _, second = name.partition(" ")
    command = app[first][second] if second in tuple(app[first]) else app[first]
    return GENERAL | {name for argument in command.assemble_argument_collection() for name in argument.names}


NAMES = [*(name for name in app if not name.startswith("-")), "cart identify"]
ALL = FOREIGN.union(*map(_options, NAMES))

ROOMS = ("agents", "benchmarks", "coheft", "configs", "consensus", "docs", "examples", "physics_server", "tests")
OURS = {str(path.relative_to(ROOT)) for room in ROOMS for path in (ROOT / room).rglob("*.py")}


def _named(page: Path) -> Iterator[str]:
    """What a page says in code that test_docs.py does not run."""
    yield from INLINE.findall(re.sub(r"^```.*?^```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL))
    yield from (line for block in blocks(page) if not commands(block) for line in block.lines if "coheft " in line)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_names_commands_and_options_that_exist(page: Path) -> None:
    for text in _named(page):
        if (match := COMMAND.search(text)) and match[1].split()[0] not in ("COMMAND", "from"):
            missing = set(OPTION.findall(match[2])) - _options(match[1])
        else:
            missing = set(OPTION.findall(text)) - ALL if text.startswith("--") else set()
        assert not missing, f"`{text}` on {page.name}: there is no {', '.join(missing)}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_names_modules_that_exist(page: Path) -> None:
    for text in _named(page):
        for name in MODULE.findall(text):
            assert name in OURS or any(each.endswith(f"/{name}") for each in OURS), f"`{name}` on {page.name}"


def test_troubleshooting_names_wrenches_that_fit_no_load_at_unknown_poses() -> None:
    assert NO_LOAD_AT_POSES.partition(": ")[0] in (ROOT / "docs" / "troubleshooting.md").read_text()


@pytest.mark.parametrize("outcome", [Outcome.NO_BODY, Outcome.BEYOND_TOLERANCE, Outcome.NO_LOAD])
def test_the_page_on_troubles_has_advice_for_every_outcome(outcome: Outcome) -> None:
    assert f"| `{outcome.value}` |" in (ROOT / "docs" / "troubleshooting.md").read_text()

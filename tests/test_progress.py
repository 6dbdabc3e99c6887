"""How far a command with many runs has come is shown, on a terminal or elsewhere."""

from __future__ import annotations

import re
from io import StringIO

import pytest
from rich.console import Console

from coheft.app.terminal.progress import show_progress
from tests.escapes import SEQUENCE


def shown(total: int, *, terminal: bool = False, quiet: bool = False, width: int = 80) -> str:
    """What is shown while all is done, one after the other."""
    out = StringIO()
    console = Console(file=out, force_terminal=terminal, width=width, quiet=quiet)
    with show_progress(console, "runs", total) as told:
        for done in range(1, total + 1):
            told("0 failed" if done == total else "")
    return out.getvalue()


@pytest.mark.parametrize(
    ("total", "lines"),
    [
        (1, ["1 of 1 runs, 0 failed"]),
        (3, ["1 of 3 runs", "2 of 3 runs", "3 of 3 runs, 0 failed"]),
        (1000, [f"{100 * tenth} of 1000 runs" for tenth in range(1, 10)] + ["1000 of 1000 runs, 0 failed"]),
    ],
)
def test_where_there_is_no_terminal_a_tenth_is_a_line(total: int, lines: list[str]) -> None:
    assert shown(total).splitlines() == lines


def test_on_a_terminal_there_is_a_bar() -> None:
    text = shown(12, terminal=True)
    assert "12/12" in text
    assert "0 failed" in text
    assert "of 12 runs" not in text


@pytest.mark.parametrize("width", [18, 30, 49, 50, 80])
def test_in_a_window_of_any_width_the_count_is_complete(width: int) -> None:
    text = SEQUENCE.sub("", shown(1200, terminal=True, width=width))
    assert "1200/1200" in text
    assert "0 failed" in " ".join(text.split())
    assert "…" not in text
    assert max(map(len, re.split("[\r\n]", text))) <= width


@pytest.mark.parametrize("terminal", [False, True])
def test_quiet_is_quiet(terminal: bool) -> None:
    assert shown(12, terminal=terminal, quiet=True) == ""

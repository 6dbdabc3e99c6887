"""What people see, drawn into a string."""

from __future__ import annotations

import io
import re
from collections.abc import Callable

import pytest
from rich.console import Console

from coheft.app.record import Record
from coheft.app.terminal import LineDisplay, LiveDisplay, QuietDisplay, make_display
from coheft.wire.messages import Problem
from tests.synthetic_run import changing_run, estimate, recorded

ESCAPE = re.compile(r"\x1b\[[0-9;?]*[a-zA-Z]")


@pytest.fixture
def record() -> Record:
    """Four seconds; the load changes at two, and r3 has not found out yet."""
    truths, estimates = changing_run({"r1": 110, "r2": 120, "r3": 500}, {})
    record = recorded(truths, estimates)
    record.add_estimate(estimate("r1", 200, None, converged=False, phase="poses"))
    return record


def terminal(*, is_terminal: bool) -> Console:
    return Console(file=io.StringIO(), width=80, force_terminal=is_terminal, legacy_windows=False)


def drawn(console: Console) -> str:
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_a_terminal_shows_every_robot_in_80_columns(record: Record) -> None:
    console = terminal(is_terminal=True)
    with LiveDisplay(console) as display:
        display.update(record)
    text = ESCAPE.sub("", drawn(console))
    for words in ("4.0 of 4 s", "true mass 13.00 kg", "finding neighbours", "13.000 ± 0.100 kg", "10.000 ± 0.100 kg"):
        assert words in text
    assert max(len(line) for line in text.splitlines()) <= 80


def test_a_problem_stands_above_the_table(record: Record) -> None:
    console = terminal(is_terminal=True)
    with LiveDisplay(console) as display:
        display.update(record)
        display.problem(Problem(source="r2", text="refused [nonsense]"))
    assert "r2: refused [nonsense]" in ESCAPE.sub("", drawn(console))


def test_without_a_terminal_there_are_plain_lines(record: Record) -> None:
    console = terminal(is_terminal=False)
    with LineDisplay(console) as display:
        display.note("waiting for r1")
        display.note("waiting for r1")
        display.update(record)
        assert drawn(console) == "waiting for r1\n", "no line before five seconds"
    assert "\x1b" not in drawn(console)


@pytest.mark.parametrize(
    ("is_terminal", "quiet", "kind"),
    [(True, False, LiveDisplay), (False, False, LineDisplay), (True, True, QuietDisplay), (False, True, QuietDisplay)],
)
def test_the_display_fits(is_terminal: bool, quiet: bool, kind: Callable[..., object]) -> None:
    assert type(make_display(terminal(is_terminal=is_terminal), quiet=quiet)) is kind


def test_no_color_is_honoured(record: Record, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    console = terminal(is_terminal=True)
    with LiveDisplay(console) as display:
        display.update(record)
    assert not re.search(r"\x1b\[3[0-9]m", drawn(console))

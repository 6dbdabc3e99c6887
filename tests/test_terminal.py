"""What people see while a run goes on, drawn into a string."""

from __future__ import annotations

import io
import math
from collections.abc import Callable

import msgspec
import numpy as np
import pytest
from rich.console import Console

from coheft.app.results.record import Record
from coheft.app.terminal.digits import significant, value_and_std
from coheft.app.terminal.screen import Display, LineDisplay, LiveDisplay, make_display
from coheft.wire.messages.structs import Estimate, Problem, Validity
from coheft.wire.messages.truth import Scene
from tests.escapes import COLOUR, SEQUENCE
from tests.recording.runs import BEGIN
from tests.synthetic_run import BLOCK, HEAVY, LIGHT, SCENE, changing_run, estimate, recorded, truth


@pytest.fixture
def record() -> Record:
    """Four seconds; the load changes at two, and r3 has not found out yet."""
    truths, estimates = changing_run({"r1": 110, "r2": 120, "r3": 500}, {})
    record = recorded(truths, estimates)
    record.receive(estimate("r1", 200, None, converged=False, phase="poses"))
    return record


def terminal(*, is_terminal: bool) -> Console:
    return Console(file=io.StringIO(), width=80, force_terminal=is_terminal, legacy_windows=False)


def drawn(console: Console) -> str:
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_a_terminal_shows_every_robot_in_80_columns(record: Record) -> None:
    console = terminal(is_terminal=True)
    with LiveDisplay(console) as display:
        display.begin(msgspec.structs.replace(BEGIN, estimator="fan2017"))
        display.update(record)
    text = SEQUENCE.sub("", drawn(console))
    assert "ring3: 3 robots, estimator fan2017, the method of Fan et al. (CDC 2017)" in text
    for words in ("4.0 of 4 s", "true mass 13.00 kg", "finding neighbours", "13.000 ± 0.100 kg", "10.000 ± 0.100 kg"):
        assert words in text
    assert max(len(line) for line in text.splitlines()) <= 80


def test_a_problem_stands_above_the_table(record: Record) -> None:
    console = terminal(is_terminal=True)
    with LiveDisplay(console) as display:
        display.update(record)
        display.problem(Problem(source="r2", text="refused [nonsense]"))
    assert "r2: refused [nonsense]" in SEQUENCE.sub("", drawn(console))


def test_without_a_terminal_there_are_plain_lines(record: Record) -> None:
    console = terminal(is_terminal=False)
    with LineDisplay(console) as display:
        display.begin(BEGIN)
        display.note("waiting for r1")
        display.note("waiting for r1")
        display.update(record)
        first, *lines = drawn(console).splitlines()
        assert first == "ring3: 3 robots, estimator efficient, which reaches the Cramér-Rao bound"
        assert lines == ["waiting for r1", "  2.0 s: the payload is 13.00 kg now"], "no other line before five seconds"
    assert "\x1b" not in drawn(console)


def stale(robot: str, block: int, reason: str) -> Estimate:
    return msgspec.structs.replace(estimate(robot, block, HEAVY), status=Validity.STALE, reasons=[reason])


def test_a_terminal_shows_who_is_stale_and_why(record: Record) -> None:
    for robot in ("r1", "r2"):
        record.receive(stale(robot, 201, "r3 is silent since 3.98 s, and " + 80 * "!"))
    console = terminal(is_terminal=True)
    with LiveDisplay(console) as display:
        display.update(record)
    lines = SEQUENCE.sub("", drawn(console)).splitlines()
    for start in ("r1     stale", "r2     stale"):
        assert any(line.startswith(start) for line in lines)
    assert any(line.startswith("stale r1, r2: r3 is silent since 3.98 s, and !!!") for line in lines)
    assert max(map(len, lines)) <= 80


TEAM = [f"r{number:02}" for number in range(1, 25)]
STATES = {"stale": 3, "finding neighbours": 4, "all known": 5, "converged": 12}


def large_team() -> Record:
    """24 robots, those that are worst off come last."""
    robots = len(TEAM)
    neighbours = {name: [TEAM[(k + 1) % robots]] for k, name in enumerate(TEAM)}
    poses = {"rotations": np.tile(np.eye(3), (robots, 1, 1)), "translations": np.zeros((robots, 3))}
    record = Record(Scene(robots=TEAM, neighbours=neighbours, **poses), duration=20.0)
    samples = np.zeros((robots, 15))
    record.receive(msgspec.structs.replace(truth(9, HEAVY), samples=samples))
    likes = {
        "stale": stale("r1", 9, "r3 is silent"),
        "finding neighbours": estimate("r1", 9, None, converged=False, phase="poses"),
        "all known": estimate("r1", 9, HEAVY, converged=False),
        "converged": estimate("r1", 9, HEAVY),
    }
    states = [state for state, count in reversed(STATES.items()) for _ in range(count)]
    for name, state in zip(TEAM, states, strict=True):
        reasons = [f"{name} feels something"] if state == "stale" else []
        record.receive(msgspec.structs.replace(likes[state], robot=name, poses={}, reasons=reasons))
    return record


def picture(record: Record, width: int, height: int) -> list[str]:
    """The lines of the last drawing."""
    out = io.StringIO()
    with LiveDisplay(Console(file=out, width=width, height=height, force_terminal=True)) as display:
        display.update(record)
        drawing = out.getvalue()
    lines = SEQUENCE.sub("", drawing).split("\r")[-1].splitlines()
    assert len(lines) <= height
    assert max(map(len, lines)) <= width
    return [line.rstrip() for line in lines]


def test_a_window_that_has_too_few_lines_for_all_robots_shows_the_worst_and_how_many_more_there_are() -> None:
    lines = picture(large_team(), 80, 20)
    assert [line.split()[0] for line in lines[2:15]] == [*TEAM[21:], *TEAM[17:21], *TEAM[12:17], TEAM[0]]
    assert lines[15] == "and 11 more: 11 converged"
    assert lines[16:] == [f"stale {name}: {name} feels something" for name in TEAM[21:]]
    assert [line.split()[0] for line in picture(large_team(), 80, 30)[2:26]] == TEAM, "as in the team if all fit"


def test_a_window_of_few_lines_has_room_for_a_robot_and_a_reason() -> None:
    lines = picture(large_team(), 80, 6)
    assert lines[2].startswith("r22    stale")
    assert lines[3] == "and 23 more: 2 stale, 4 finding neighbours, 5 all known, 12 converged"
    assert lines[4] == "and 3 more reasons"


@pytest.mark.parametrize(("width", "height"), [(60, 24), (30, 24), (80, 5)])
def test_in_a_window_without_room_for_a_row_a_line_stands_for_all(width: int, height: int) -> None:
    text = " ".join(" ".join(picture(large_team(), width, height)).split())
    assert text == (
        "0.2 s of 20 s: 12 converged, 5 all known, 4 finding neighbours, 3 stale; mass 13.00 to 13.00 kg (true 13.00)"
    )


def test_plain_lines_tell_once_that_all_have_noticed_another_load() -> None:
    truths, estimates = changing_run({"r1": 110, "r2": 120, "r3": 115}, {"r1": 2.06, "r2": 2.04, "r3": 2.1})
    console = terminal(is_terminal=False)
    display, record = LineDisplay(console), recorded(truths, estimates)
    for _ in range(3):
        display.update(record)
    assert drawn(console).splitlines() == [
        "  2.0 s: the payload is 13.00 kg now",
        "  2.1 s: all robots have noticed the change",
    ]


def test_plain_lines_tell_how_things_stand_before_what_has_happened_since() -> None:
    """However many truths came at once."""
    record = Record(SCENE, duration=20.0)
    console = terminal(is_terminal=False)
    display = LineDisplay(console)
    at = round(5.0 / BLOCK)
    for block in range(at + 1):
        record.receive(truth(block, LIGHT if block < at else HEAVY))
    display.update(record)
    first, second = drawn(console).splitlines()
    assert first.startswith("  5.0 s of 20 s")
    assert second == "  5.0 s: the payload is 13.00 kg now"


def test_plain_lines_tell_why_a_run_waits_each_time_that_it_does() -> None:
    record, console = Record(SCENE, duration=20.0), terminal(is_terminal=False)
    display = LineDisplay(console)
    for block in range(2):
        for _ in range(3):
            display.note("waiting for r1")
            display.update(record)
        record.receive(truth(block, LIGHT))
        display.update(record)
    assert drawn(console).splitlines() == ["waiting for r1"] * 2


def test_what_robots_say_in_their_own_coordinates_is_told_as_one() -> None:
    record = Record(SCENE, duration=20.0)
    record.receive(truth(0, HEAVY))
    for robot, axis in (("r1", "(0.52, 0.79, 0.32)"), ("r3", "(1.00, 0.00, 0.00)")):
        record.receive(stale(robot, 0, f"centre of mass along {axis}: tilt the load"))
    console = terminal(is_terminal=True)
    with LiveDisplay(console) as display:
        display.update(record)
    lines = SEQUENCE.sub("", drawn(console)).splitlines()
    assert "stale r1, r3: centre of mass in some directions: tilt the load" in map(str.rstrip, lines)


def test_plain_lines_tell_when_estimates_stay_stale_and_when_none_is_any_more() -> None:
    record = Record(SCENE, duration=20.0)
    console = terminal(is_terminal=False)
    display = LineDisplay(console)
    for block in range(200):
        record.receive(truth(block, HEAVY))
        for robot in ("r1", "r2"):
            is_stale = 10 <= block < 45 or 60 <= block < 130
            record.receive(stale(robot, block, "r3 is silent") if is_stale else estimate(robot, block, HEAVY))
            display.update(record)
    assert drawn(console).splitlines() == [
        "  2.5 s: stale r1, r2: r3 is silent",
        "  3.0 s: no estimate is stale any more",
    ]


def test_a_std_that_stands_beside_its_value_has_two_digits() -> None:
    assert value_and_std(13.00004, 0.00113) == "13.0000 ± 0.0011"
    assert value_and_std(13.00004, 0.1) == "13.000 ± 0.100"


def test_large_and_small_numbers_have_no_exponent() -> None:
    shown = [significant(value, 2) for value in (0.0, 0.000012, 0.018, 1.0, 9.96, 152.0, 12345.0, math.inf)]
    assert shown == ["0", "0.000012", "0.018", "1", "10", "150", "12000", "inf"]


@pytest.mark.parametrize(
    ("is_terminal", "quiet", "kind"),
    [(True, False, LiveDisplay), (False, False, LineDisplay), (True, True, Display), (False, True, Display)],
)
def test_the_display_fits(is_terminal: bool, quiet: bool, kind: Callable[..., object]) -> None:
    console = terminal(is_terminal=is_terminal)
    console.quiet = quiet
    assert type(make_display(console)) is kind


def test_no_color_is_honoured(record: Record, monkeypatch: pytest.MonkeyPatch) -> None:
    def text() -> str:
        console = terminal(is_terminal=True)
        with LiveDisplay(console) as display:
            display.update(record)
        return drawn(console)

    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert COLOUR.search(text())
    monkeypatch.setenv("NO_COLOR", "1")
    assert not COLOUR.search(text())

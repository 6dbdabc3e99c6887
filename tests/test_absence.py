"""How long the return of a robot is waited for."""

from __future__ import annotations

import pytest

from coheft.physics_server.absence import Absences
from tests.wall_clock import WallClock, wall_clock_of


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> WallClock:
    return wall_clock_of("coheft.physics_server.absence", monkeypatch)


def test_who_does_not_come_back_in_time_is_given_up_and_may_come_back_later(now: WallClock) -> None:
    absences = Absences(10.0)
    absences.begin("r1")
    now.time += 9.9
    assert absences.give_up() == []
    assert absences.waited_for == ["r1"]
    now.time += 0.2
    assert absences.give_up() == ["r1"]
    assert (absences.waited_for, absences.given_up) == ([], {"r1"})
    absences.end("r1")
    assert absences.given_up == set()
    absences.begin("r1")
    assert absences.waited_for == ["r1"]


def test_who_comes_and_goes_is_not_waited_for_for_ever(now: WallClock) -> None:
    """As an agent that dies as soon as its link stands, and is started again every time."""
    absences = Absences(10.0)
    absences.begin("r1")
    for _ in range(5):
        now.time += 2.1
        absences.begin("r1")
    assert absences.give_up() == ["r1"]
    absences.begin("r1")
    assert (absences.waited_for, absences.given_up) == ([], {"r1"})

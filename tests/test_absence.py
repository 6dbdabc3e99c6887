"""How long the return of a robot is waited for."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from coheft.errors import LinkError
from coheft.physics_server.robots import Robots
from tests.wall_clock import WallClock, wall_clock_of


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> WallClock:
    return wall_clock_of("coheft.physics_server.robots", monkeypatch)


class Link(SimpleNamespace):
    """Of a robot that is ready whenever its link stands."""

    def note_link(self, is_linked: bool) -> None:
        self.is_ready = is_linked and self.is_ready

    def take(self, _: object) -> None:
        self.is_ready = True

    def join(self, block: int) -> None:
        """Nothing follows."""


def running(told: list[str], *names: str) -> Robots:
    links = [Link(name=name, is_ready=True, is_linked=True, answered=-1, owes_answer=False) for name in names]
    robots = Robots(links, SimpleNamespace(tell=told.append), return_limit=10.0)
    robots.go_on()
    return robots


def test_who_does_not_come_back_in_time_is_given_up_and_may_come_back_later(now: WallClock) -> None:
    told: list[str] = []
    robots = running(told, "r1", "r2")
    robots.note_link("r1", False)
    now.time += 9.9
    robots.check()
    assert robots.away == ["r1"]
    now.time += 0.2
    robots.check()
    assert robots.away == []
    assert told[-1] == "r1 did not return within 10 s: the run continues without it"
    robots.take("r1", object())
    assert told[-1] == "r1 is back before block 0"
    robots.note_link("r1", False)
    assert robots.away == ["r1"]


def test_who_comes_and_goes_is_not_waited_for_without_end(now: WallClock) -> None:
    """As an agent that dies as soon as its link stands, and is started again every time."""
    robots = running([], "r1")
    robots.note_link("r1", False)
    for _ in range(5):
        now.time += 2.1
        robots.note_link("r1", True)
        robots.note_link("r1", False)
    with pytest.raises(LinkError, match="all robots are lost, and none returned within 10 s"):
        robots.check()
    robots.note_link("r1", False)
    assert robots.away == []

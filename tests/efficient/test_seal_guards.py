"""Each guard of seals does something: without it, robots sign or check more often, or use rows that are not signed.

A line of robots whose first one listens: its neighbour hands on all rows, and may change or drop what it hands on.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from coheft.agents.efficient.exchange import Exchange, RowMessage
from coheft.agents.efficient.row_times import RowTimes
from coheft.agents.efficient.seals import Seals, SealTimes
from coheft.agents.efficient.settings import Guards
from coheft.agents.estimator import Channels
from coheft.estimation.moments.rows import ROW_SIZE
from coheft.wire.config import agent_config
from coheft.wire.scenario.file import load_scenario

WITHOUT: dict[str, float] = {"sealed_every": 0.0, "sealed_alike": 10**9, "sealed_within": 1e9, "distrusting": 0.0}
"""Values with which guards have no effect."""
CONFIG = agent_config(load_scenario("ring3"), "r1", ("r2",))
BLOCKS = CONFIG.blocks(6.0)
LIE = 1.0
"""What the liar adds to rows; those of robots are larger."""


@dataclass
class Signer:
    """Signs with a hash; counts."""

    name: str
    signed: int = 0
    checked: int = 0

    def sign(self, content: bytes) -> bytes:
        self.signed += 1
        return hashlib.sha256(self.name.encode() + content).digest()

    def is_signed_by(self, robot: str, content: bytes, signature: bytes) -> bool:
        self.checked += 1
        return signature == hashlib.sha256(robot.encode() + content).digest()


class Robot:
    """Rows and seals of one robot of a team, without any estimation."""

    def __init__(self, count: int, own: int, guards: Guards) -> None:
        names, hops = [f"r{1 + robot}" for robot in range(count)], count - 1
        times = RowTimes.of_team(count, CONFIG.block, CONFIG.rate)
        assert times.row == CONFIG.block
        seal_times = SealTimes.of_team(count, hops, times, CONFIG, guards)
        self._own, self.signer = own, Signer(names[own])
        self.exchange = Exchange(7, count, own, hops, times, ROW_SIZE, seal_times.window(times))
        self._seals = Seals(names, own, 0, self.exchange, times, seal_times, self.signer)

    def step(self, block: int, heard: list[tuple[RowMessage, Channels]]) -> tuple[RowMessage, Channels]:
        self.exchange.receive([message for message, _ in heard], block)
        for _, channels in heard:
            self._seals.receive(channels, block)
        self.exchange.add_own(block, np.full(ROW_SIZE, 10.0 * self._own + 10.0))
        self._seals.seal(block)
        self._seals.check(block)
        return replace(self.exchange.message(-1), sender=self.signer.name), self._seals.channels()

    def used(self, number: int) -> float | None:
        """What the last robot's row of this number holds, None if the rows of this number are not used."""
        row = self.exchange.complete(number) if self._seals.may_use(number) else None
        return None if row is None else float(row[-2])


@dataclass
class Heard:
    """What the first robot of a line has signed, checked, and used: whether false or true rows, by block."""

    signed: int = 0
    checked: int = 0
    false: list[int] = field(default_factory=list)
    true: list[int] = field(default_factory=list)


def lying(message: RowMessage, channels: Channels) -> tuple[RowMessage, Channels]:
    rows = message.rows.copy()
    rows[message.labels[:, 0] == 2] += LIE
    return replace(message, rows=rows), channels


def without_seals(message: RowMessage, channels: Channels) -> tuple[RowMessage, Channels]:
    seals = channels["seals"]
    return message, {"seals": seals[seals[:, 0] == 1]}


def line(
    guards: Guards, count: int = 3, change: Callable[[RowMessage, Channels], tuple[RowMessage, Channels]] | None = None
) -> Heard:
    team, heard, said = [Robot(count, own, guards) for own in range(count)], Heard(), []
    for block in range(BLOCKS):
        if said and change is not None:
            said[1] = change(*said[1])
        said = [
            robot.step(block, [said[other] for other in (own - 1, own + 1) if 0 <= other < len(said)])
            for own, robot in enumerate(team)
        ]
        value = team[0].used(block - count + 1)
        if value is not None:
            (heard.true if value == 10.0 * count else heard.false).append(block)
    return replace(heard, signed=team[0].signer.signed, checked=team[0].signer.checked)


def without(guard: str) -> Guards:
    return replace(Guards(), **{guard: WITHOUT[guard]})


def test_robots_sign_several_rows_at_once() -> None:
    assert 0 < 10 * line(Guards()).signed < line(without("sealed_every")).signed


def test_in_larger_teams_robots_sign_less_often_so_that_each_checks_no_more() -> None:
    checked, always = (line(guards, count=20).checked for guards in (Guards(), without("sealed_alike")))
    assert 0 < 1.5 * checked < always


def test_rows_whose_seals_do_not_come_are_used_for_a_limited_time_only() -> None:
    assert line(Guards()).true[-1] == BLOCKS - 1
    limited, unlimited = (line(guards, change=without_seals) for guards in (Guards(), without("sealed_within")))
    assert 0 < limited.true[-1] < CONFIG.blocks(1.5)
    assert unlimited.true[-1] == BLOCKS - 1


def test_who_has_handed_on_false_rows_is_not_believed_again_at_once() -> None:
    believed_once, believed_always = (line(guards, change=lying) for guards in (Guards(), without("distrusting")))
    assert 0 < believed_once.false[-1] < CONFIG.blocks(1.0)
    assert believed_always.false[-1] > BLOCKS - CONFIG.blocks(1.0)

"""Samples from before follow, the newest first, each once, and never mixed with others."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import msgspec
import numpy as np
import pytest

from agents.early_sums import EARLY, PACE, EarlySums
from coheft.estimation.motion_fusion import summands
from coheft.estimation.spatial import Array, Pose
from coheft.wire.config import AgentConfig, agent_config
from consensus.graph import Neighbours
from consensus.schedule import choose_schedule
from tests.in_process import changed

GRAPH: Neighbours = {"r1": ("r2",), "r2": ("r1", "r3"), "r3": ("r2",)}
BLOCK = 2
SCHEDULE = choose_schedule(GRAPH)


@pytest.fixture(scope="module")
def configs() -> dict[str, AgentConfig]:
    scenario = changed("ring3")
    sensors = msgspec.structs.replace(scenario.sensors, rate=20, block=BLOCK)
    return {
        name: agent_config(msgspec.structs.replace(scenario, sensors=sensors), name, others)
        for name, others in GRAPH.items()
    }


def samples(name: str, block: int) -> Array:
    """What a robot measured."""
    return np.random.default_rng([ord(name[1]), block]).normal(size=(BLOCK, 15))


class Team:
    """Three robots, from one start on, that remember what they measure."""

    def __init__(
        self,
        configs: Mapping[str, AgentConfig],
        start: int,
        has: Callable[[str, int], bool] = lambda name, block: True,
    ) -> None:
        self.configs, self.index, self.has = configs, start, has
        self.each = {
            name: EarlySums(
                configs[name],
                GRAPH[name],
                SCHEDULE,
                start,
                {block: samples(name, block) for block in range(start) if has(name, block)},
            )
            for name in GRAPH
        }
        self.told: dict[str, dict[str, Array]] = {name: {} for name in GRAPH}
        self.versions = dict.fromkeys(GRAPH, 0)

    def begin(self, start: int, names: Iterable[str] = GRAPH) -> None:
        """These robots begin again, with poses of the next version."""
        for name in names:
            self.each[name].begin(start)
            self.versions[name] += 1

    def run(self, steps: int) -> list[int]:
        """The blocks that have gone through; their sums are right for everybody for whom there is one."""
        came = []
        for _ in range(steps):
            before, self.told, newest = self.told, {}, []
            for name, early in self.each.items():
                if self.has(name, self.index):
                    early.remember(self.index, samples(name, self.index))
                inbox = {other: before[other] for other in GRAPH[name]}
                finished = early.step(self.index, Pose.identity(), self.versions[name], inbox)
                self.told[name] = early.channels()
                if finished is not None:
                    self.check(name, *finished)
                    newest.append(finished[0].block)
            assert len(set(newest)) <= 1
            came += newest[:1]
            self.index += 1
        return came

    def check(self, name: str, entered: object, sums: Array) -> None:
        first = entered.block  # type: ignore[attr-defined]
        blocks = range(first, first + PACE)
        np.testing.assert_array_equal(entered.samples, np.concatenate([samples(name, block) for block in blocks]))  # type: ignore[attr-defined]
        noise = self.configs[name].noise
        expected = np.sum(
            [summands(np.concatenate([samples(other, block) for block in blocks]), noise) for other in GRAPH], axis=0
        )
        np.testing.assert_allclose(sums, expected, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("start", [20, 21, 1])
def test_all_follow_once_the_newest_first(configs: dict[str, AgentConfig], start: int) -> None:
    team = Team(configs, start)
    assert team.run(40) == list(range(start - PACE, -1, -PACE))


def test_not_more_than_the_last_ten_seconds_follow(configs: dict[str, AgentConfig]) -> None:
    reach = configs["r1"].blocks(EARLY)
    team = Team(configs, 10, lambda name, block: block % 7 != 3)
    team.run(3 * reach)
    assert all(len(early._history) <= reach for early in team.each.values())
    start = team.index
    team.begin(start)
    team.has = lambda name, block: True
    came = team.run(reach)
    assert came[0] in (start - PACE, start - 2 * PACE)
    assert start - reach <= min(came) <= start - reach + 2 * PACE
    assert team.each["r1"].are_over(start + reach)


def test_what_one_robot_has_not_measured_is_left_out(configs: dict[str, AgentConfig]) -> None:
    team = Team(configs, 20, lambda name, block: (name, block) != ("r2", 11))
    assert team.run(40) == [block for block in range(18, -1, -PACE) if block not in (10, 11)]


def test_all_follow_again_when_the_sums_begin_again(configs: dict[str, AgentConfig]) -> None:
    team = Team(configs, 20)
    first = team.run(8)
    team.begin(28)
    assert first == list(range(18, 18 - PACE * len(first), -PACE))
    assert team.run(40) == list(range(28 - PACE, -1, -PACE))


def test_a_robot_that_hears_late_of_the_new_beginning_mixes_nothing(configs: dict[str, AgentConfig]) -> None:
    team = Team(configs, 20)
    team.run(8)
    team.begin(28, ["r1", "r2"])
    late = 3
    came = team.run(late)
    team.begin(28, ["r3"])
    came += team.run(40)
    assert came == [6, *range(28 - PACE * (late + 1), -1, -PACE)]  # the first one was under way, and all had the same


def test_nothing_follows_after_the_end_but_what_is_measured_later(configs: dict[str, AgentConfig]) -> None:
    team = Team(configs, 20)
    team.run(5)
    for early in team.each.values():
        early.end()
        assert early.are_over(team.index)
    team.run(SCHEDULE.rounds)
    assert team.run(10) == []
    team.begin(team.index)
    assert team.run(40) == list(range(team.index - 40 - PACE, 24, -PACE))

"""Robots of a team take turns in testing whether the load has changed."""

from __future__ import annotations

import msgspec
import pytest

from agents.make_memory import make_memory
from coheft.estimation.load_change import LoadWindow
from coheft.wire.config import AgentConfig, agent_config
from tests.in_process import changed


def config_of(block: int) -> AgentConfig:
    """Of a robot with 100 blocks of samples a second, or fewer."""
    scenario = changed("ring6")
    sensors = msgspec.structs.replace(scenario.sensors, rate=1000, block=block)
    return agent_config(msgspec.structs.replace(scenario, sensors=sensors), "r3", ("r2", "r4"))


def turns_of(block: int, members: int) -> list[list[int]]:
    """For each robot, the number of the test that it makes after each of 60 blocks, -1 where it makes none."""
    windows = [make_memory(config_of(block), own, members) for own in range(members)]
    turns = []
    for window in windows:
        assert isinstance(window, LoadWindow)
        reviews = [divmod(window._reviews + k, window._every) for k in range(1, 61)]
        turns.append([turn if rest == 0 else -1 for turn, rest in reviews])
    return turns


@pytest.mark.parametrize(("block", "members"), [(20, 6), (20, 3), (20, 24), (50, 6), (50, 3), (100, 6), (200, 4)])
def test_some_robot_tests_soon_after_every_block(block: int, members: int) -> None:
    tested = [any(turn >= 0 for turn in after) for after in zip(*turns_of(block, members), strict=True)]
    longest = max(2, round(0.12 * 1000 / block) // members + 1)
    assert all(any(tested[k : k + longest]) for k in range(len(tested) - longest))


def test_six_robots_test_one_after_the_other() -> None:
    counts = [sum(turn >= 0 for turn in after) for after in zip(*turns_of(20, 6), strict=True)]
    assert set(counts) == {1}


def test_those_who_test_one_after_the_other_test_other_borders() -> None:
    """Every third one, from one that hangs on the number of the test."""
    by_block = [[turn for turn in after if turn >= 0] for after in zip(*turns_of(20, 6), strict=True)]
    thirds = [turn % 3 for (turn,) in by_block]
    assert all(len(set(thirds[k : k + 3])) == 3 for k in range(0, 54, 6))

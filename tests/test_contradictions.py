"""Robots whose sensors do not fit the team's motion are found, and named, and start over."""

from __future__ import annotations

import numpy as np
import pytest

from agents.contradictions import Contradictions
from coheft.estimation.measurement import KINEMATICS
from coheft.estimation.registration import RegistrationMoments
from coheft.estimation.spatial import Array
from coheft.wire.config import agent_config
from tests.estimation.team import Team, make_team
from tests.in_process import changed

NAMES = ("r1", "r2", "r3")
DEVIATIONS = np.repeat([1e-4, 1e-4], 3)
BLOCK = 10
MEMORY = 15
"""Blocks that are looked back on."""


def numbered(table: Array) -> Array:
    """A table's rows as they are sent."""
    return np.column_stack([np.arange(len(table)), table])


class Watching:
    """Three robots of an exact team that watch; sensors of some are wrong."""

    def __init__(self, wrong: dict[str, float]) -> None:
        self.team: Team = make_team(3, count=3, duration=8.0)
        rng = np.random.default_rng(1)
        self.samples: Array = self.team.measured(rng)
        for name, offset in wrong.items():
            self.samples[:, NAMES.index(name), :3] *= 1.0 + offset
        scenario = changed("ring3")
        self.unlike: list[tuple[int, str]] = []
        self.robots = [
            Contradictions(
                agent_config(scenario, name, tuple(o for o in NAMES if o != name)),
                NAMES,
                self.team.poses[k],
                DEVIATIONS,
            )
            for k, name in enumerate(NAMES)
        ]

    def run(self, first: int, blocks: int, *, early: bool = False, complete: bool = True) -> None:
        for block in range(first, first + blocks):
            rows = slice(block * BLOCK, (block + 1) * BLOCK)
            for k, robot in enumerate(self.robots):
                if complete:
                    moments = RegistrationMoments.of(self.samples[rows, k, KINEMATICS], self.team.motion[rows])
                    like = (robot.add_early if early else robot.add)(moments)
                    self.unlike += [] if like else [(block, NAMES[k])]
                robot.step(block)
            for robot in self.robots:
                for other in self.robots:
                    robot.flood.hear("", other.flood.digest, numbered(other.flood.table))


def test_nobody_is_blamed_without_reason() -> None:
    watching = Watching({})
    watching.run(0, 70)
    assert [robot.suspect for robot in watching.robots] == [None] * 3
    assert not any(robot.have_lasted or robot.anybodys_have_lasted for robot in watching.robots)
    assert watching.unlike == []


@pytest.mark.parametrize("early", [False, True])
def test_who_is_wrong_is_named_by_all_and_starts_over(early: bool) -> None:
    watching = Watching({"r2": 0.5})
    watching.run(0, 70, early=early)
    assert [robot.suspect for robot in watching.robots] == ["r2"] * 3
    assert [robot.have_lasted for robot in watching.robots] == [False, True, False]


def test_while_no_sum_is_complete_nobody_is_blamed_any_longer() -> None:
    watching = Watching({})
    watching.samples[20 * BLOCK : 25 * BLOCK, 1, :3] *= 3.0
    watching.run(0, 25)
    assert [robot.suspect for robot in watching.robots] == ["r2"] * 3
    watching.run(25, 35, complete=False)  # 0.7 s
    assert [robot.suspect for robot in watching.robots] == ["r2"] * 3
    assert not any(robot.have_lasted or robot.anybodys_have_lasted for robot in watching.robots)
    watching.run(60, 18)
    assert [robot.suspect for robot in watching.robots] == [None] * 3
    assert not any(robot.have_lasted or robot.anybodys_have_lasted for robot in watching.robots)


@pytest.mark.parametrize("early", [False, True])
@pytest.mark.parametrize("column", [0, 3], ids=["gyro", "velocity"])
def test_blocks_with_a_sensor_that_is_off_for_a_moment_are_not_used(column: int, early: bool) -> None:
    watching = Watching({})
    sigma = watching.team.noise.per_column()[column]
    watching.samples[30 * BLOCK : 32 * BLOCK, 1, column : column + 3] += 6.0 * sigma
    watching.run(0, 70, early=early)
    assert {block for block, name in watching.unlike if name == "r2"} >= {30, 31}
    assert all(30 <= block < 32 for block, _ in watching.unlike)


def test_a_sensor_that_stays_off_is_taken_as_it_is_after_a_while() -> None:
    watching = Watching({})
    watching.samples[30 * BLOCK :, 1, :3] += 6.0 * watching.team.noise.gyro
    watching.run(0, 70)
    assert {block for block, name in watching.unlike if name == "r2"} == set(range(30, 30 + MEMORY))


def test_a_constant_offset_does_no_harm() -> None:
    watching = Watching({})
    watching.samples[:, 1, :6] += 3.0 * watching.team.noise.per_column()[:6]
    watching.run(0, 70)
    assert watching.unlike == []


def test_two_that_take_turns_do_not_go_on_for_ever() -> None:
    watching = Watching({})
    for block in range(200):
        for k, robot in enumerate(watching.robots):
            misfit = 5.0 if k < 2 and (block // 3 + k) % 2 == 0 else 2.0 if k < 2 else 0.1
            robot.flood.tell(k, block, np.array([misfit]))
        rows = slice(block % 70 * BLOCK, (block % 70 + 1) * BLOCK)
        for k, robot in enumerate(watching.robots):
            for other in watching.robots:
                robot.flood.hear("", other.flood.digest, numbered(other.flood.table))
            # Its own sensors fit, so it tells nothing itself.
            robot.add(RegistrationMoments.of(watching.samples[rows, k, KINEMATICS], watching.team.motion[rows]))
            robot.step(block)
    assert [robot.have_lasted for robot in watching.robots] == [True, True, False]
    assert all(robot.anybodys_have_lasted for robot in watching.robots)

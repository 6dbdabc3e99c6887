"""Sums with outliers: what no robot can have measured is left out, what loads do is not."""

from __future__ import annotations

import numpy as np
import pytest

from agents.sums import Entered
from agents.total_motion import TotalMotion
from coheft.estimation.motion_fusion import summands
from coheft.estimation.spatial import Array, Pose
from tests.estimation.team import Team, make_team
from tests.memory.memories import BLOCK, own_config

COUNT = 6


@pytest.fixture(scope="module")
def team() -> Team:
    return make_team(3, count=COUNT, duration=1.0)


@pytest.fixture
def motion(team: Team) -> TotalMotion:
    return TotalMotion(own_config(), team.poses)


def sums(team: Team) -> Array:
    """Of a team's samples with noise, carried to the body frame, shape (blocks, B, 3, 6)."""
    rng = np.random.default_rng(1)
    samples = team.exact + rng.normal(size=team.exact.shape) * team.noise.per_column()
    total = sum(summands(samples[:, i], team.noise) @ pose.adjoint().T for i, pose in enumerate(team.poses))
    return np.asarray(total).reshape(-1, BLOCK, 3, 6)


def looked_at(motion: TotalMotion, team: Team, blocks: Array) -> list[bool]:
    """Which of these blocks can be looked at, the rest having been left out."""
    seen = []
    for number, block in enumerate(blocks):
        newest = motion.add(Entered(number, np.zeros((BLOCK, 15)), team.poses[0], 0), block)
        assert newest in (number, None)
        seen.append(newest is not None and motion.look_at(number, lambda _: None) is not None)
    return seen


def test_sums_of_what_robots_measure_are_looked_at_whatever_the_load_does(motion: TotalMotion, team: Team) -> None:
    blocks = sums(team)
    blocks[4:, :, 0] += 100.0 * motion.fusion.deviations[0]
    blocks[6, 5:, 0] -= 50.0 * motion.fusion.deviations[0]
    blocks[7:, :, 0] -= 50.0 * motion.fusion.deviations[0]
    assert looked_at(motion, team, blocks) == len(blocks) * [True]


@pytest.mark.parametrize("size", [60.0, 1e12, 1e300])
@pytest.mark.parametrize("at", range(BLOCK))
@pytest.mark.parametrize("row", range(3))
def test_one_number_that_is_far_off_spoils_a_block(
    motion: TotalMotion, team: Team, row: int, at: int, size: float
) -> None:
    blocks = sums(team)
    blocks[4, at, row, 1] += size * motion.fusion.deviations[row, 1]
    expected = [number != 4 for number in range(len(blocks))]
    assert looked_at(motion, team, blocks) == expected


def test_a_number_where_nobody_adds_anything_spoils_a_block() -> None:
    alone = TotalMotion(own_config(), [Pose(np.eye(3), np.zeros(3))])
    silent = np.zeros((BLOCK, 3, 6))
    assert alone.are_plausible(silent)
    assert alone.fusion.deviations[1, 4] == 0.0
    silent[3, 1, 4] = 1.0
    assert not alone.are_plausible(silent)

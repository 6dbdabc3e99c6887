"""What a team leaves of its poses, and what the next one makes of it."""

from __future__ import annotations

import numpy as np
import pytest

from agents.known_pose import WELL_KNOWN, KnownPose, known_from_before, passed_on
from coheft.estimation.observability import Visibility
from coheft.estimation.spatial import Array
from coheft.estimation.team_registration import TeamPoses
from tests.estimation.team import random_pose

ROBOTS = 3
POSES = tuple(random_pose(np.random.default_rng(5)) for _ in range(ROBOTS))


def team(deviations: Array, correlation: float = 0.0) -> TeamPoses:
    """All robots but the first know their poses with these deviations (6,), and all errors go together."""
    scale = np.concatenate([np.zeros(6), np.tile(deviations, ROBOTS - 1)])
    matrix = (1.0 - correlation) * np.eye(len(scale)) + correlation
    return TeamPoses(POSES, scale[:, None] * matrix * scale, Visibility())


def test_what_is_known_well_is_passed_on_with_larger_deviations_where_errors_go_together() -> None:
    known = known_from_before(passed_on(POSES, team(1e-3 * np.arange(1.0, 7.0), correlation=0.5)))
    assert known is not None
    assert known.poses == POSES
    larger = known.deviations[1:] / (1e-3 * np.arange(1.0, 7.0))
    np.testing.assert_allclose(larger, np.sqrt(0.5 + 0.5 * 6.0 * (ROBOTS - 1)))


def test_what_is_not_known_well_is_passed_on_without_deviations() -> None:
    for each in passed_on(POSES, team(1.01 * WELL_KNOWN)):
        assert each.deviations is None


def test_what_is_known_exactly_is_not_passed_on_as_such() -> None:
    known = known_from_before(passed_on(POSES, team(np.full(6, 1e-9))))
    assert known is not None
    assert np.all(known.deviations[1:] >= 1e-6)


@pytest.mark.parametrize("wrong", [-1.0, 0.0, 1e-160, 1.0, np.inf, np.nan])
def test_a_deviation_that_cannot_be_is_none(wrong: float) -> None:
    numbers = KnownPose(POSES[1], np.full(6, 1e-3)).numbers()
    numbers[-1] = wrong
    known = KnownPose.of_numbers(numbers)
    assert known is not None
    assert known.deviations is None
    assert KnownPose.of(POSES[1], numbers[12:]).deviations is None


def test_numbers_are_those_of_the_pose_and_its_deviations() -> None:
    for deviations in (None, np.full(6, 1e-3)):
        known = KnownPose.of_numbers(KnownPose(POSES[1], deviations).numbers())
        assert known is not None
        assert np.array_equal(known.pose.numbers(), POSES[1].numbers())
        assert known.deviations is None if deviations is None else np.array_equal(known.deviations, deviations)


def test_nothing_is_known_of_all_if_one_is_unknown_or_another_robot_defined_the_frame() -> None:
    first, *others = passed_on(POSES, team(np.full(6, 1e-3)))
    assert known_from_before([first, *others]) is not None
    assert known_from_before([first, others[0], KnownPose(POSES[2])]) is None
    assert known_from_before([others[0], first, others[1]]) is None
    assert known_from_before([first, first, others[1]]) is None

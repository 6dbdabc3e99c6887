"""Moments of wrenches commute with sums over the network, and follow the poses."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.estimation.body_motion import perturbed
from coheft.estimation.measurement import WRENCH
from coheft.estimation.team_registration import refit_map
from coheft.estimation.wrench_moments import WrenchMoments
from tests.estimation.team import make_team
from tests.estimation.test_team_registration import fused_motion


def test_moments_of_the_total_are_the_total_of_the_moments() -> None:
    team = make_team(1, duration=2.0)
    wrenches = team.measured(np.random.default_rng(0))[:, :, WRENCH]
    total = sum(wrenches[:, i] @ pose.adjoint().T for i, pose in enumerate(team.poses))
    expected = WrenchMoments.of(np.asarray(total), team.motion)
    summed = WrenchMoments.none()
    for half in (slice(0, 100), slice(100, 200)):
        for i, pose in enumerate(team.poses):
            summed = summed + WrenchMoments.of(wrenches[half, i], team.motion[half]).carried(pose)
    np.testing.assert_allclose(summed.cross, expected.cross, atol=1e-9 * np.abs(expected.cross).max())


def test_better_poses_repair_moments_of_earlier_samples() -> None:
    team = make_team(1, duration=5.0)
    rng = np.random.default_rng(0)
    samples = team.measured(rng)
    old = [team.poses[0], *(perturbed(pose, 0.003 * rng.normal(size=6)) for pose in team.poses[1:])]
    motion_old, motion_new = (fused_motion(samples, poses, team.noise) for poses in (old, team.poses))
    before, expected = (WrenchMoments.of(samples[:, 2, WRENCH], motion) for motion in (motion_old, motion_new))
    repaired = before.mapped(refit_map(old, team.poses, team.noise))
    distance = np.linalg.norm(repaired.cross - expected.cross)
    assert distance < 0.1 * np.linalg.norm(before.cross - expected.cross)


def test_shapes_are_checked() -> None:
    with pytest.raises(ValueError, match=r"expected \(n, 6\) and \(n, 12\)"):
        WrenchMoments.of(np.zeros((5, 6)), np.zeros((4, 12)))

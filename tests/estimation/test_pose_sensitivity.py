"""What errors of poses do to the inertia, against summing all samples again with perturbed poses."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from coheft.estimation.body_motion import perturbed
from coheft.estimation.inertia import InertiaModel, features, packed_gram, unpacked_gram
from coheft.estimation.measurement import WRENCH
from coheft.estimation.motion_fusion import MotionFusion, derivative_kernel
from coheft.estimation.pose_sensitivity import MOTION_FEATURES, PoseSensitivity, inertia_by_poses
from coheft.estimation.registration import ACCELERATION, PRODUCTS
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.team_registration import NO_SLOPE, motion_by_poses, refit_map
from tests.estimation.fusion import fusion_of
from tests.estimation.team import Team, make_team
from tests.estimation.test_team_registration import fused_motion


def by_all_poses(of: Callable[[Sequence[Pose]], Array], poses: Sequence[Pose], step: float) -> Array:
    """Central differences by the perturbations of all poses, these first."""
    columns = []
    for i, k in np.ndindex(len(poses), 6):
        ahead, behind = list(poses), list(poses)
        ahead[i] = perturbed(poses[i], step * np.eye(6)[k])
        behind[i] = perturbed(poses[i], -step * np.eye(6)[k])
        columns.append((of(ahead) - of(behind)) / (2.0 * step))
    return np.array(columns)


def sample_features(team: Team, poses: Sequence[Pose]) -> Array:
    """Features (n, 19) of exact samples, summed with these poses."""
    total = sum(team.exact[:, i, WRENCH] @ pose.adjoint().T for i, pose in enumerate(poses))
    return features(fused_motion(team.exact, poses, team.noise), np.asarray(total))


def slope_information(team: Team, poses: Sequence[Pose]) -> Array:
    """What a slope over a second says, which is more than the accelerometers do."""
    return MotionFusion.of_robots(team.noise, poses, derivative_kernel(10, 0.1)).slope_information


@pytest.mark.parametrize("is_slope_used", [False, True], ids=["accelerometers", "slope as well"])
@pytest.mark.parametrize("count", [3, 6])
def test_motion_by_poses(count: int, is_slope_used: bool) -> None:
    team = make_team(3, count=count, duration=0.1)
    assert slope_information(team, team.poses).any()

    def slope(poses: Sequence[Pose]) -> Array:
        return slope_information(team, poses) if is_slope_used else NO_SLOPE

    numeric = by_all_poses(
        lambda poses: refit_map(team.poses, poses, team.noise, slope(poses))[ACCELERATION], team.poses, step=1e-6
    )
    analytic = motion_by_poses(team.poses, team.noise, slope(team.poses))
    np.testing.assert_allclose(
        analytic.swapaxes(0, 1)[:, :, : PRODUCTS.start], numeric[:, :, : PRODUCTS.start], atol=1e-8
    )


@pytest.mark.parametrize("with_offset", [False, True])
@pytest.mark.parametrize("count", [3, 6])
def test_inertia_by_poses(count: int, with_offset: bool) -> None:
    team = make_team(3, count=count, duration=6.0)
    fusion = fusion_of(team)
    # Samples are exact: there is no noise to compensate.
    model = InertiaModel(
        fusion.wrench_covariance, 1e-9 * fusion.acceleration_covariance, team.inertia.barycentric(), with_offset
    )

    def estimate(poses: Sequence[Pose]) -> Array:
        information = model.information(packed_gram(sample_features(team, poses)))
        solution: Array = np.linalg.solve(information.matrix, information.vector)
        return solution[:10]

    rows = sample_features(team, team.poses)
    analytic = inertia_by_poses(
        model,
        model.information(packed_gram(rows)),
        team.inertia.barycentric(),
        unpacked_gram(packed_gram(rows)),
        np.array([rows[:, MOTION_FEATURES].T @ team.exact[:, i, WRENCH] for i in range(count)]),
        PoseSensitivity.of(team.poses, team.noise),
    )
    numeric = by_all_poses(estimate, team.poses, step=1e-5).T
    # What turning the body frame does to products of w is left out.
    for derivative, expected in zip(analytic, numeric, strict=True):
        assert np.linalg.norm(derivative - expected) < 0.02 * np.linalg.norm(expected)

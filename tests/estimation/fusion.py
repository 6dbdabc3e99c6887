"""What a team's network would sum, and what an agent makes of it."""

from __future__ import annotations

import numpy as np

from coheft.estimation.inertia import features
from coheft.estimation.motion_fusion import (
    MotionFusion,
    carried_constants,
    derivative_kernel,
    robot_constants,
    summands,
)
from coheft.estimation.spatial import Array, Pose
from tests.estimation.team import Team


def seen_from(team: Team, i: int) -> list[Pose]:
    """Poses of all grasp frames in ``F_i``."""
    to_i = team.poses[i].inverse()
    return [to_i @ pose for pose in team.poses]


def summed(team: Team, samples: Array, i: int = 0) -> Array:
    """The network's sum (n, 3, 6) in ``F_i`` of samples (n, N, 15)."""
    return np.sum(
        [summands(samples[:, j], team.noise) @ pose.adjoint().T for j, pose in enumerate(seen_from(team, i))],
        axis=0,
    )


def fusion_of(team: Team, i: int = 0, period: float = 0.01) -> MotionFusion:
    constants = np.sum([carried_constants(robot_constants(team.noise), pose) for pose in seen_from(team, i)], axis=0)
    return MotionFusion.of(constants, derivative_kernel(2, period))


def fused_features(team: Team, samples: Array) -> Array:
    """Features (n, 19) in the body frame, of a team whose accelerometers see everything."""
    sums = summed(team, samples)
    return features(fusion_of(team).motion(sums), sums[:, 0])

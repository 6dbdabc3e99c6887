"""How errors of the robots' poses become errors of the load's inertia."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coheft.estimation.inertia import INERTIA_SIZE, InertiaInformation, InertiaModel, spatial_inertia
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.registration import ACCELERATION, PRODUCTS
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.team_registration import NO_SLOPE, motion_by_poses
from coheft.estimation.twist_registration import adjoint_derivative

REGISTRATION_FEATURES = np.r_[0, ACCELERATION, PRODUCTS]
"""Where the motion's features of ``coheft.estimation.inertia`` stand among those of ``registration``."""
MOTION_FEATURES = slice(0, len(REGISTRATION_FEATURES))
"""The same among those of ``inertia``."""


@dataclass(frozen=True, eq=False)
class PoseSensitivity:
    """How sums over the team follow when poses are perturbed.

    Attributes:
        adjoints: Derivative of every ``Ad(g_j)`` by its pose's perturbation, transposed, shape (N, 6, 6, 6):
            perturbations third.
        motion: Derivative of the fused ``(a, alpha)`` by all perturbations, linear in the sample's motion features,
            shape (6, 6 N, 13).
    """

    adjoints: Array
    motion: Array

    @staticmethod
    def of(poses: Sequence[Pose], noise: SensorNoise, slope: Array = NO_SLOPE) -> PoseSensitivity:
        """Of samples that were summed with these poses, in the body frame.

        Args:
            poses: Of all robots.
            noise: Of every robot's sensors.
            slope: What the gyros' slope says about ``(a, alpha)``, shape (6, 6), if motions were found with it.
        """
        motion = motion_by_poses(poses, noise, slope)[:, :, REGISTRATION_FEATURES]
        adjoints = np.array([adjoint_derivative(pose).transpose(2, 0, 1) for pose in poses])
        return PoseSensitivity(adjoints, np.ascontiguousarray(motion))


def inertia_by_poses(
    model: InertiaModel,
    information: InertiaInformation,
    parameters: Array,
    gram: Array,
    crosses: Array,
    sensitivity: PoseSensitivity,
) -> Array:
    """Derivative of the estimate of ``theta`` by the perturbations of all poses with which samples were summed.

    A pose that is off spoils the total wrench, by what this robot pushes, and the fused motion:
    ``d theta = H^-1 sum X^T W (dAd_j u_j - M d(a, alpha))``.

    Args:
        model: Weights.
        information: Of the samples.
        parameters: ``theta`` (10,).
        gram: Of the samples' features, shape (19, 19).
        crosses: Of the motion's features with each robot's own wrench, shape (N, 13, 6).
        sensitivity: At the poses.

    Returns:
        Shape (10, 6 N).
    """
    of_motion = model.weighted_regressor[MOTION_FEATURES].swapaxes(0, 1).reshape(model.unknowns, -1)
    robots, features, _ = crosses.shape
    # Moments of the features with dAd_j u_j, and with M d(a, alpha), shape (6 N, features, 6).
    wrench = (crosses @ sensitivity.adjoints.reshape(robots, 6, -1)).reshape(robots, features, 6, 6)
    moved = (spatial_inertia(parameters) @ sensitivity.motion.reshape(6, -1)).reshape(-1, features)
    needed = (moved @ gram[MOTION_FEATURES, MOTION_FEATURES]).reshape(6, -1, features)
    moments = wrench.swapaxes(1, 2).reshape(-1, features, 6) - needed.transpose(1, 2, 0)
    score = of_motion @ moments.reshape(len(moments), -1).T
    solution = np.linalg.solve(information.matrix, score).astype(np.float64)
    return solution[:INERTIA_SIZE]

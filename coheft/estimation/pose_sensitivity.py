"""How errors of the robots' poses become errors of the load's inertia."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coheft.estimation import inertia as inertia_module
from coheft.estimation.inertia import FEATURES, InertiaInformation, InertiaModel, spatial_inertia
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.registration import ACCELERATION, PRODUCTS
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.team_registration import motion_by_poses
from coheft.estimation.twist_registration import adjoint_derivative

REGISTRATION_FEATURES = np.r_[0, ACCELERATION, PRODUCTS]
"""Where the motion's features of ``coheft.estimation.inertia`` stand among those of ``registration``."""
MOTION_FEATURES = slice(0, len(REGISTRATION_FEATURES))
"""The same among those of ``inertia``."""


def inertia_by_poses(
    model: InertiaModel,
    information: InertiaInformation,
    parameters: Array,
    gram: Array,
    crosses: Array,
    poses: Sequence[Pose],
    noise: SensorNoise,
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
        poses: In the body frame.
        noise: Of every robot's sensors.

    Returns:
        Shape (10, 6 N).
    """
    coefficients = model.regressor_coefficients
    weight = np.linalg.inv(model.residual_covariance)
    weighted = np.einsum("fau,ab->fub", coefficients, weight)
    by_wrench = [
        np.einsum("fub,kbf->uk", weighted[MOTION_FEATURES], adjoint_derivative(pose) @ cross.T)
        for pose, cross in zip(poses, crosses, strict=True)
    ]
    by_motion = np.zeros((6 * len(poses), 6, FEATURES))
    by_motion[:, :, MOTION_FEATURES] = motion_by_poses(poses, noise)[:, :, REGISTRATION_FEATURES]
    spatial = spatial_inertia(parameters)
    score = np.hstack(by_wrench) - np.einsum("fub,kbf->uk", weighted, spatial @ by_motion @ gram)
    result: Array = np.linalg.solve(information.matrix, score)[: inertia_module.INERTIA_SIZE]
    return result

"""Errors of an estimate, and whether they contradict its own covariance."""

import numpy as np

from coheft.estimation.geometry.spatial import Array, Pose, rotation_log
from coheft.estimation.rigid_body.mass_properties import Inertia, pack_symmetric
from coheft.wire.messages.structs import PayloadEstimate, PoseEstimate

MOST_STDS = 4.0
"""An error of more own standard deviations contradicts the estimate: by chance that happens to one in 16,000
numbers."""
VALID_STDS = 5.0
"""No number of a valid estimate should be off by more own standard deviations, see ``Validity``."""
_ROUNDING = 1e-9
"""Errors below this are rounding errors, in their own units: kg, m, kg·m², rad."""
PAYLOAD_SIZE = 10
PAYLOAD_PARTS = {"mass": slice(0, 1), "centre of mass": slice(1, 4), "inertia": slice(4, 10)}
"""Slices of ``(m, h, J packed)``."""


def pose_error(truth: Pose, estimate: PoseEstimate) -> Array:
    """Return truth minus estimate of ``pose_j_in_i``: rotation vector in axes of ``F_i`` [rad], translation [m];
    (6,).
    """
    return np.concatenate(
        [rotation_log(truth.rotation @ estimate.rotation.T), truth.translation - estimate.translation]
    )


def payload_error(truth: Inertia, estimate: PayloadEstimate) -> Array:
    """Return truth minus estimate of the known part of ``(m, h, J packed)``, shape (1,), (4,) or (10,) [kg, m,
    kg·m²].
    """
    com = truth.com if estimate.com is None else estimate.com
    tensor = truth.tensor if estimate.tensor is None else estimate.tensor
    every = np.concatenate([[truth.mass - estimate.mass], truth.com - com, pack_symmetric(truth.tensor - tensor)])
    return every[: len(estimate.covariance)]


def in_full(known: Array) -> Array:
    """Return the known part of ``(m, h, J packed)``, or of its covariance, with NaN for the rest: shape (k,) to (10,),
    or (k, k) to (10, 10).
    """
    full = np.full((PAYLOAD_SIZE,) * known.ndim, np.nan)
    full[(slice(len(known)),) * known.ndim] = known
    return full


def in_stds(error: Array, covariance: Array) -> Array:
    """Return each number's error in its own standard deviations, shapes (k,) and (k, k) to (k,); rounding errors count
    as 0.

    Parameters that a robot knew at the start have no deviation: their error is zero or infinite.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        stds = np.abs(error) / np.sqrt(np.diagonal(covariance))
    return np.where(np.abs(error) < _ROUNDING, 0.0, stds)

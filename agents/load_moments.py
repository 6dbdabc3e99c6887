"""What is summed of a block of samples for the load: one vector, as ``Memory`` takes it.

The packed Gram matrix of motion and total wrench, how much poses disturb the wrenches, and the own robot's share of the
cross moments, ``C_i = sum x u_i^T`` of motion features ``x`` with own wrenches ``u_i`` in ``F_i``.
"""

from __future__ import annotations

import numpy as np

from coheft.estimation.inertia import FEATURES, GRAM_SIZE, features, packed_gram, repacked_gram, unpacked_gram
from coheft.estimation.pose_sensitivity import MOTION_FEATURES, REGISTRATION_FEATURES
from coheft.estimation.spatial import Array

CROSS_SHAPE = (MOTION_FEATURES.stop, 6)
CROSS_SIZE = CROSS_SHAPE[0] * CROSS_SHAPE[1]
RIDERS = 1 + CROSS_SIZE
"""Numbers beside the Gram matrix."""
_DISTURBANCE = GRAM_SIZE
_CROSS = slice(_DISTURBANCE + 1, _DISTURBANCE + 1 + CROSS_SIZE)


def load_moments(motion: Array, wrench: Array, own_wrench: Array, disturbance: float) -> Array:
    """Of a block.

    Args:
        motion: Of the body frame, shape (B, 12).
        wrench: Total, in the body frame, shape (B, 6).
        own_wrench: This robot's in ``F_i``, shape (B, 6).
        disturbance: Variance that poses add to wrenches, in units of the noise.
    """
    rows = features(motion, wrench)
    cross = rows[:, MOTION_FEATURES].T @ own_wrench
    return np.concatenate([packed_gram(rows), [len(rows) * disturbance], cross.ravel()])


def number_of_samples(sums: Array) -> float:
    """Number of samples."""
    return float(sums[0])


def cross_moments(sums: Array) -> Array:
    """``C_i``, shape (13, 6)."""
    return sums[_CROSS].reshape(CROSS_SHAPE)


def disturbed(sums: Array, disturbance: float, lacked: float) -> Array:
    """What sums (k, 190 + riders) become when poses disturb samples as said, and some as before, too.

    Args:
        sums: Of stretches of samples.
        disturbance: As in ``load_moments``.
        lacked: How many samples of a stretch may still be disturbed as before.
    """
    result = sums.copy()
    still = np.minimum(1.0, lacked / np.maximum(sums[:, 0], 1.0))
    result[:, _DISTURBANCE] = sums[:, 0] * disturbance + still * sums[:, _DISTURBANCE]
    return result


def gram_map(feature_map: Array) -> Array:
    """What all samples' features become (19, 19) when those of registration become ``feature_map`` (28, 28) times."""
    result = np.eye(FEATURES)
    result[MOTION_FEATURES, MOTION_FEATURES] = feature_map[np.ix_(REGISTRATION_FEATURES, REGISTRATION_FEATURES)]
    return result


def mapped(sums: Array, to_new: Array) -> Array:
    """Sums (k, 190 + riders) as if all features had been ``to_new`` (19, 19) times what they were."""
    gram = to_new @ unpacked_gram(sums[:, :GRAM_SIZE]) @ to_new.T
    cross = to_new[MOTION_FEATURES, MOTION_FEATURES] @ sums[:, _CROSS].reshape(-1, *CROSS_SHAPE)
    return np.hstack([repacked_gram(gram), sums[:, _DISTURBANCE, None], cross.reshape(len(sums), -1)])

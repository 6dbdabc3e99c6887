"""What is summed of a block of samples for the load: one vector, as ``Memory`` takes it.

The packed Gram matrix of motion and total wrench, what former poses have left in the wrenches, the square of the own
robot's forces, and its share of the cross moments, ``C_i = sum x u_i^T`` of motion features ``x`` with own wrenches
``u_i`` in ``F_i``.
"""

from __future__ import annotations

import numpy as np

from coheft.estimation.inertia import FEATURES, GRAM_SIZE, repacked_gram, unpacked_gram
from coheft.estimation.measurement import KINEMATICS, WRENCH
from coheft.estimation.pose_sensitivity import MOTION_FEATURES, REGISTRATION_FEATURES
from coheft.estimation.registration import FEATURES as REGISTRATION_SIZE
from coheft.estimation.registration import RegistrationMoments, registration_features
from coheft.estimation.spatial import Array

CROSS_SHAPE = (MOTION_FEATURES.stop, 6)
CROSS_SIZE = CROSS_SHAPE[0] * CROSS_SHAPE[1]
RIDERS = 2 + CROSS_SIZE
"""Numbers beside the Gram matrix."""
HARDLY_MORE = 1.02
"""While there are no more than so many times as many samples, what they say is not worth finding anew."""
_LEFT = GRAM_SIZE
_SQUARE = _LEFT + 1
_CROSS = slice(_SQUARE + 1, _SQUARE + 1 + CROSS_SIZE)

_ROW = REGISTRATION_SIZE + 12
"""Numbers of a sample that all moments are of: those of its registration, total wrench, own wrench."""
_TOTAL_WRENCH, _OWN_WRENCH = np.arange(REGISTRATION_SIZE, _ROW).reshape(2, 6)
_FEATURES = np.concatenate([REGISTRATION_FEATURES, _TOTAL_WRENCH])
"""Where those of ``coheft.estimation.inertia`` stand among them."""
_PACKED = repacked_gram(_FEATURES[:, None] * _ROW + _FEATURES).astype(np.intp)
_CROSSED = (REGISTRATION_FEATURES[:, None] * _ROW + _OWN_WRENCH).ravel()


def block_moments(samples: Array, motion: Array, wrench: Array) -> tuple[RegistrationMoments, Array]:
    """Of a block: what it says of the own pose, and of the load.

    Args:
        samples: Own, shape (B, 15).
        motion: Of the body frame, shape (B, 12).
        wrench: Total, in the body frame, shape (B, 6).

    Returns:
        Moments of ``registration``, and one vector (190 + ``RIDERS``,).
    """
    rows = np.empty((len(samples), _ROW))
    registration_features(samples[:, KINEMATICS], motion, out=rows)
    rows[:, _TOTAL_WRENCH[0] : _OWN_WRENCH[0]], rows[:, _OWN_WRENCH[0] :] = wrench, samples[:, WRENCH]
    gram = rows.T @ rows
    force = gram.diagonal()[_OWN_WRENCH[0] : _OWN_WRENCH[3]]
    load = np.concatenate([gram.take(_PACKED), [0.0, force.sum()], gram.take(_CROSSED)])
    return RegistrationMoments(gram[:REGISTRATION_SIZE, :REGISTRATION_SIZE].copy()), load


def number_of_samples(sums: Array) -> float:
    """Number of samples."""
    return float(sums[0])


def sum_of_squares(sums: Array) -> float:
    """Of the norms of the own forces [N²]."""
    return float(sums[_SQUARE])


def cross_moments(sums: Array) -> Array:
    """``C_i``, shape (13, 6)."""
    return sums[_CROSS].reshape(CROSS_SHAPE)


def disturbed(sums: Array, left: float) -> Array:
    """Sums (k, 190 + riders) of samples in whose wrenches poses that are no longer in use have left something.

    Args:
        sums: Of stretches of samples.
        left: Its variance, in units of the noise.
    """
    result = sums.copy()
    result[:, _LEFT] += sums[:, 0] * left
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
    return np.hstack([repacked_gram(gram), sums[:, [_LEFT, _SQUARE]], cross.reshape(len(sums), -1)])

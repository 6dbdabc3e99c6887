"""The linear model of motions and wrenches in the inertial parameters.

Barycentric model, unknown ``theta = (m, m h, I_o)`` about the origin of ``F_i`` (Atkeson, An, Hollerbach 1986):

    F = m a + ([alpha]x + [w]x^2) (m h),    T = I_o alpha + w x I_o w + (m h) x a

and optionally a constant offset ``(F_0, T_0)`` of the total wrench, the sum of the offsets of all force-torque sensors.
Residuals are linear in ``FEATURES`` = 19 numbers per sample: 1, ``a``, ``alpha``, six products of ``w``, ``F``, ``T``.
"""

from functools import lru_cache

import numpy as np

from coheft.estimation.geometry.body_motion import BODY_A, BODY_ALPHA, BODY_W
from coheft.estimation.geometry.spatial import Array, skew
from coheft.estimation.rigid_body.mass_properties import (
    PACKED_COLUMNS,
    PACKED_ROWS,
    inertia_operator,
    unpack_symmetric,
)

FEATURES = 19
WRENCH_FEATURES = slice(13, 19)
"""Columns of the total wrench among the features."""
INERTIA_SIZE = 10
OFFSET_SIZE = 6
_ONE, _A, _ALPHA, _PRODUCTS = 0, slice(1, 4), slice(4, 7), slice(7, 13)
_ACCELERATIONS = slice(_A.start, _ALPHA.stop)
_IDENTITY = np.eye(6)


def symmetric_products(w: Array) -> Array:
    """Return ``w w^T`` packed as ``(xx, yy, zz, xy, xz, yz)``, shape (n, 3) to (n, 6)."""
    return w.take(PACKED_ROWS, axis=1) * w.take(PACKED_COLUMNS, axis=1)


def _products_regressor() -> Array:
    """Return shape (6, 6, 10): ``symmetric_products(w)[k] * result[k]`` add up to the part of the regressor due to
    ``w``.
    """
    regressor = np.zeros((6, 6, INERTIA_SIZE))
    for k, product in enumerate(unpack_symmetric(np.eye(6))):
        regressor[k, :3, 1:4] = product - np.trace(product) * np.eye(3)
        # w x I w is the axial vector of I w w^T.
        turned = unpack_symmetric(np.eye(6)) @ product
        regressor[k, 3:, 4:] = [
            turned[:, 2, 1] - turned[:, 1, 2],
            turned[:, 0, 2] - turned[:, 2, 0],
            turned[:, 1, 0] - turned[:, 0, 1],
        ]
    return regressor


_OF_PRODUCTS = _products_regressor()


def features(motion: Array, wrench: Array) -> Array:
    """Return the features of samples, shape (n, 19).

    Args:
        motion: Body motion ``(w, v, a, alpha)`` at ``F_i``, shape (n, 12).
        wrench: Total wrench ``(F, T)`` about the origin of ``F_i``, shape (n, 6).
    """
    result = np.empty((len(motion), FEATURES))
    result[:, _ONE] = 1.0
    result[:, _ACCELERATIONS] = motion[:, BODY_A.start : BODY_ALPHA.stop]
    result[:, _PRODUCTS] = symmetric_products(motion[:, BODY_W])
    result[:, WRENCH_FEATURES] = wrench
    return result


def spatial_inertia(parameters: Array) -> Array:
    """Return ``M`` (6, 6) with ``(F, T) = M (a, alpha)`` of a body with ``theta`` (10,) and no angular velocity."""
    spatial: Array = parameters[0] * _IDENTITY
    spatial[3:, :3] = moment = skew(parameters[1:4])
    spatial[:3, 3:] = -moment
    spatial[3:, 3:] = unpack_symmetric(parameters[4:10])
    return spatial


@lru_cache
def regressor_coefficients(with_offset: bool) -> Array:
    """Return shape (19, 6, u + 1): features times these add up to ``[regressor | wrench]``. The array is read-only."""
    size = INERTIA_SIZE + (OFFSET_SIZE if with_offset else 0) + 1
    result = np.zeros((FEATURES, 6, size))
    axes = np.eye(3)
    result[_A, :3, 0] = axes
    result[_A, 3:, 1:4] = -skew(axes)
    result[_ALPHA, :3, 1:4] = skew(axes)
    result[_ALPHA, 3:, 4:10] = inertia_operator(axes)
    result[_PRODUCTS, :, :INERTIA_SIZE] = _OF_PRODUCTS
    result[WRENCH_FEATURES, :, -1] = np.eye(6)
    if with_offset:
        result[_ONE, :, INERTIA_SIZE:-1] = np.eye(6)
    result.flags.writeable = False
    return result

"""Derivatives of mass properties by their parameters and by the frame in which they are given."""

from functools import lru_cache

import numpy as np

from coheft.estimation.geometry.spatial import CROSS_OF_AXES, Array, Pose, skew
from coheft.estimation.rigid_body.mass_properties import Inertia, pack_symmetric, packed_rotation
from coheft.estimation.rigid_body.regressor import INERTIA_SIZE

_DOUBLE_CROSS = pack_symmetric(
    CROSS_OF_AXES[:, None] @ CROSS_OF_AXES + CROSS_OF_AXES @ CROSS_OF_AXES[:, None]
).transpose(2, 0, 1)
"""Shape (6, 3, 3): ``result @ h`` is the derivative of the packed ``[h]x [h]x`` by ``h``."""
_POSES = 64
"""Number of poses for which results are cached."""


def barycentric_derivative(inertia: Inertia) -> Array:
    """Return the derivative (10, 10) of ``(m, m h, I_o)`` by ``(m, h, J)``, with ``J`` about the centre of mass,
    packed.
    """
    m, h = inertia.mass, inertia.com
    of_square = _DOUBLE_CROSS @ h
    derivative = np.eye(INERTIA_SIZE)
    derivative[1:4, 0] = h
    derivative[1:4, 1:4] *= m
    derivative[4:, 0] = -0.5 * of_square @ h
    derivative[4:, 1:4] = -m * of_square
    return derivative


def central_derivative(inertia: Inertia) -> Array:
    """Return the inverse of ``barycentric_derivative``: of ``(m, h, J)`` by ``(m, m h, I_o)``, shape (10, 10)."""
    m, h = inertia.mass, inertia.com
    of_square = _DOUBLE_CROSS @ h
    derivative = np.eye(INERTIA_SIZE)
    derivative[1:4, 0] = -h / m
    derivative[1:4, 1:4] /= m
    derivative[4:, 0] = -0.5 * of_square @ h
    derivative[4:, 1:4] = of_square
    return derivative


def seen_inertia_derivative(pose_i: Pose, inertia: Inertia) -> Array:
    """Return the derivative of ``(m, h_i, J_i)`` by perturbations of ``F_i`` and ``(m, h, J)``, given in the body
    frame.

    Returns:
        Shape (10, 16): by the perturbation of ``pose_i``, then by ``(m, h, J)``.
    """
    to_i = pose_i.rotation.T
    derivative = _of_axes(pose_i).copy()
    derivative[1:4, 0:3] = to_i @ skew(inertia.com - pose_i.translation)
    turned = inertia.tensor @ CROSS_OF_AXES - CROSS_OF_AXES @ inertia.tensor
    derivative[4:, 0:3] = pack_symmetric(to_i @ turned @ to_i.T).T
    return derivative


@lru_cache(maxsize=_POSES)
def _of_axes(pose_i: Pose) -> Array:
    """Return the part of ``seen_inertia_derivative`` that does not depend on the inertia. The array is read-only."""
    to_i = pose_i.rotation.T
    derivative = np.zeros((INERTIA_SIZE, 6 + INERTIA_SIZE))
    derivative[0, 6] = 1.0
    derivative[1:4, 3:6] = -to_i
    derivative[1:4, 7:10] = to_i
    derivative[4:, 10:] = packed_rotation(to_i)
    derivative.flags.writeable = False
    return derivative

"""How mass properties change with the parameters and the frame that they are seen with."""

from __future__ import annotations

import numpy as np

from coheft.estimation.inertia import INERTIA_SIZE
from coheft.estimation.rigid_body import Inertia, pack_symmetric, unpack_symmetric
from coheft.estimation.spatial import Array, Pose, skew


def barycentric_derivative(inertia: Inertia) -> Array:
    """Derivative (10, 10) of ``(m, m h, I_o)`` by ``(m, h, J)``, with ``J`` packed, at the centre of mass."""
    m, h = inertia.mass, inertia.com
    derivative = np.eye(INERTIA_SIZE)
    derivative[1:4, 0] = h
    derivative[1:4, 1:4] = m * np.eye(3)
    derivative[4:, 0] = pack_symmetric(-skew(h) @ skew(h))
    for k, axis in enumerate(np.eye(3)):
        derivative[4:, 1 + k] = -m * pack_symmetric(skew(axis) @ skew(h) + skew(h) @ skew(axis))
    return derivative


def seen_inertia_derivative(pose_i: Pose, inertia: Inertia) -> Array:
    """How ``(m, h_i, J_i)`` follows when ``F_i`` and ``(m, h, J)``, both given in the body frame, are perturbed.

    Returns:
        Shape (10, 16): by the perturbation of ``pose_i``, then by ``(m, h, J)``.
    """
    to_i = pose_i.rotation.T
    derivative = np.zeros((INERTIA_SIZE, 6 + INERTIA_SIZE))
    derivative[0, 6] = 1.0
    derivative[1:4, 0:3] = to_i @ skew(inertia.com - pose_i.translation)
    derivative[1:4, 3:6] = -to_i
    derivative[1:4, 7:10] = to_i
    for k, axis in enumerate(np.eye(3)):
        turned = inertia.tensor @ skew(axis) - skew(axis) @ inertia.tensor
        derivative[4:, k] = pack_symmetric(to_i @ turned @ to_i.T)
    for k, packed in enumerate(np.eye(6)):
        derivative[4:, 10 + k] = pack_symmetric(to_i @ unpack_symmetric(packed) @ to_i.T)
    return derivative

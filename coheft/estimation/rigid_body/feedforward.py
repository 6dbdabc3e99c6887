"""What robots need to know to carry a load ahead of their springs: who pushes how much, and how sure that is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coheft.estimation.geometry.spatial import Array, Pose, skew
from coheft.estimation.rigid_body.unseen import middle_and_size


def load_shares(poses: Sequence[Pose]) -> Array:
    """Matrices that share a total wrench between the robots, so that they push against each other as little as can be.

    Of all wrenches ``w_i`` with the total ``W = sum_i G_i w_i`` these have the least ``sum_i |f_i|² + |t_i|² / l²``:

        w_i = Q G_i^T (sum_j G_j Q G_j^T)^-1 W,   Q = diag(1, 1, 1, l², l², l²)

    with the adjoints ``G_i`` of the poses, and the size ``l`` of the team, which makes forces and torques comparable.
    This is the weighted pseudo-inverse of the grasp map that leaves no internal wrenches, with equal weights of all
    robots (Walker, Freeman, Marcus 1991, sec. 3; Erhart, Hirche 2015, sec. V).

    Args:
        poses: Of all robots that hold the load, ``pose_i_in_body``; the body frame may be any.

    Returns:
        Shape (N, 6, 6): from the total wrench ``(F, T)`` in the body frame to each robot's ``(f, t)`` in ``F_i``.
    """
    _, size = middle_and_size(poses)
    adjoints = np.array([pose.adjoint() for pose in poses])
    weighted = np.repeat([1.0, size * size], 3)[:, None] * adjoints.swapaxes(-1, -2)
    shares: Array = weighted @ np.linalg.inv((adjoints @ weighted).sum(axis=0))
    return shares


def internal_wrenches(wrenches: Array, poses: Sequence[Pose]) -> Array:
    """What robots push against each other: the part of their wrenches that moves nothing.

    Args:
        wrenches: ``(f, t)`` of each robot in its own ``F_i``, shape (..., N, 6).
        poses: Of all of them, ``pose_i_in_body``.

    Returns:
        Shape (..., N, 6), what is left of them without their ``load_shares`` of the total.
    """
    adjoints = np.array([pose.adjoint() for pose in poses])
    total = np.einsum("nij,...nj->...i", adjoints, wrenches)
    internal: Array = wrenches - np.einsum("nij,...j->...ni", load_shares(poses), total)
    return internal


def weight_deviations(mass: float, covariance: Array, a: Array) -> tuple[float, float]:
    """Standard deviations of the force and the torque that hold a load.

    Of ``F = m a`` and ``T = h x F``, as far as the centre of mass makes it uncertain: along ``a`` it does not matter.

    Args:
        mass: ``m`` [kg].
        covariance: Of at least ``(m, h)``, shape (k, k) with k >= 4.
        a: Proper acceleration in ``F_i``, shape (3,) [m/s²].

    Returns:
        Of the force [N], and of the torque [N·m].
    """
    lever = mass * skew(a)
    force = float(np.sqrt(covariance[0, 0] * (a @ a)))
    return force, float(np.sqrt(np.trace(lever @ covariance[1:4, 1:4] @ lever.T)))

"""Feed-forward for carrying a load: each robot's share of the wrench, and its uncertainty."""

from collections.abc import Sequence

import numpy as np

from coheft.estimation.geometry.spatial import Array, Pose, skew
from coheft.estimation.rigid_body.unobservable import middle_and_size


def load_shares(poses: Sequence[Pose]) -> Array:
    """Return the matrices that share a total wrench between the robots with the smallest possible robot wrenches.

    Among all wrenches ``w_i`` with the total ``W = sum_i G_i w_i``, these minimize ``sum_i |f_i|² + |t_i|² / l²``:

        w_i = Q G_i^T (sum_j G_j Q G_j^T)^-1 W,   Q = diag(1, 1, 1, l², l², l²)

    with the adjoints ``G_i`` of the poses, and the size ``l`` of the team, which makes forces and torques comparable.
    This is the weighted pseudo-inverse of the grasp map without internal wrenches, with equal weights of all robots
    (Walker, Freeman, Marcus 1991, sec. 3; Erhart, Hirche 2015, sec. V).

    Args:
        poses: Poses of all robots that hold the load, ``pose_i_in_body``, in any body frame.

    Returns:
        Shape (N, 6, 6): from the total wrench ``(F, T)`` in the body frame to each robot's ``(f, t)`` in ``F_i``.
    """
    _, size = middle_and_size(poses)
    adjoints = np.array([pose.adjoint() for pose in poses])
    weighted = np.repeat([1.0, size * size], 3)[:, None] * adjoints.swapaxes(-1, -2)
    shares: Array = weighted @ np.linalg.inv((adjoints @ weighted).sum(axis=0))
    return shares


def internal_wrenches(wrenches: Array, poses: Sequence[Pose]) -> Array:
    """Return the internal wrenches: the part of the robots' wrenches that does not move the load.

    Args:
        wrenches: ``(f, t)`` of each robot in its own ``F_i``, shape (..., N, 6).
        poses: Poses of all robots, ``pose_i_in_body``.

    Returns:
        Shape (..., N, 6): the wrenches minus their ``load_shares`` of the total.
    """
    adjoints = np.array([pose.adjoint() for pose in poses])
    total = np.einsum("nij,...nj->...i", adjoints, wrenches)
    internal: Array = wrenches - np.einsum("nij,...j->...ni", load_shares(poses), total)
    return internal


def weight_deviations(mass: float, covariance: Array, a: Array) -> tuple[float, float]:
    """Return the standard deviations of the force and the torque that hold a load.

    These are of ``F = m a``, and of ``T = h x F`` with an uncertain centre of mass ``h``, whose component along ``a``
    has no effect.

    Args:
        mass: ``m`` [kg].
        covariance: Covariance of at least ``(m, h)``, shape (k, k) with k >= 4.
        a: Proper acceleration in ``F_i``, shape (3,) [m/s²].

    Returns:
        Standard deviations of the force [N] and of the torque [N·m].
    """
    lever = mass * skew(a)
    force = float(np.sqrt(covariance[0, 0] * (a @ a)))
    return force, float(np.sqrt(np.trace(lever @ covariance[1:4, 1:4] @ lever.T)))

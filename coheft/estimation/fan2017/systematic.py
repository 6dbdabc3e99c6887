"""Systematic errors of the estimate: by errors of the frozen poses, and by the lag of dynamic consensus.

White noise averages out; these errors stay, so their covariance is added (beyond Fan et al.). The error of an estimated
pose comes from the sensor noise of the robots at both ends of the edge, and each robot's noise enters all of its edges
alike. So to first order each robot has a pose error of its own, and the error of an edge is the difference of those of
its ends: errors close around cycles. The estimate of robot i has two errors by this: it sees the payload from a wrong
pose, and the wrenches of all robots, each transformed by a wrong pose, add up to a wrong total.

A robot knows the effect of its own pose error on the estimate. The effects of all robots add up, so robots compute the
mean of their covariances by consensus, as that of their estimates.
"""

from collections.abc import Sequence

import numpy as np

from coheft.estimation.geometry.spatial import CROSS_OF_AXES, Array, skew
from coheft.estimation.geometry.uncertain_pose import UncertainPose
from coheft.estimation.linear_algebra import positive_part
from coheft.estimation.rigid_body.mass_properties import pack_symmetric, unpack_symmetric


def inputs_by_pose_error(wrench: Array, acceleration_by_pose_error: Array) -> Array:
    """Return the errors of a block's ``(F, T, a, alpha)`` per unit of the own pose error.

    Args:
        wrench: The robot's own ``(f, t)`` in ``F_i`` less the team's mean, shape (B, 6) [N, N·m]. The pose errors of
            all robots have the mean zero, so the mean wrench has no effect.
        acceleration_by_pose_error: Error of the angular acceleration per unit of the own pose error, shape (B, 3, 6).

    Returns:
        Shape (B, 12, 6). A pose error is ``(theta, p)``: a rotation and a translation, in the axes of ``F_i``.
    """
    result = np.zeros((len(wrench), 12, 6))
    crosses = skew(wrench[:, :3])
    result[:, 0:3, 0:3] = -crosses
    result[:, 3:6, 0:3] = -skew(wrench[:, 3:])
    result[:, 3:6, 3:6] = -crosses
    result[:, 9:12] = acceleration_by_pose_error
    return result


def pose_error_covariance(poses: Sequence[UncertainPose], centre: Array) -> Array:
    """Return the covariance (6, 6) of a robot's pose error ``(theta, p)`` at its origin: half that of an edge.

    Args:
        poses: Poses of its neighbours, ``pose_j_in_i``.
        centre: Where errors of all edges are compared, such as the middle of the payload in ``F_i``, shape (3,) [m].
    """
    at_centre = np.zeros((6, 6))
    for each in poses:
        transport = pose_error_transport(centre - each.pose.translation)
        at_centre += 0.5 / len(poses) * transport @ each.covariance @ transport.T
    back = pose_error_transport(-centre)
    return back @ at_centre @ back.T


def pose_error_transport(distance: Array) -> Array:
    """Return the matrix (6, 6) that takes ``(theta, p)`` to a point at this distance: ``p + theta x distance``."""
    result = np.eye(6)
    result[3:, :3] = -skew(distance)
    return result


def covariance_by_own_pose(by_pose_error: Array, pose_error: Array) -> Array:
    """Return the covariance of theta due to the own pose error, shape (10, 10).

    Args:
        by_pose_error: Error of ``theta = (J, h, 1/m)`` per unit of the own pose error, shape (10, 6).
        pose_error: Covariance of the own pose error, see ``pose_error_covariance``.
    """
    return by_pose_error @ pose_error @ by_pose_error.T


def covariance_by_poses(theta: Array, by_pose_error: Array, pose_error: Array, mean: Array, team: int) -> Array:
    """Return the covariance of theta due to the errors of all frozen poses, in the robot's own frame, shape (10, 10).

        sum_j C_j S C_j^T - C_i S P^T - P S C_i^T + (1 - 1/N) P S P^T

    ``C_j`` is the derivative by the pose error of robot j, and all of these add up to zero; ``S`` is the covariance of
    a pose error, and ``P`` the derivative of the payload as seen by the robot. It is computed as two squares.

    Args:
        theta: The estimate, shape (10,).
        by_pose_error: Its error per unit of the own pose error, ``C_i``, shape (10, 6).
        pose_error: ``S``, see ``pose_error_covariance``. Pose errors of different robots are independent, and only
            their deviations from the mean count.
        mean: Mean over all robots of ``covariance_by_own_pose``.
        team: Number ``N`` of robots that hold the load.
    """
    share = 1.0 - 1.0 / team
    own = np.sqrt(share) * _payload_by_pose_error(theta) - by_pose_error / np.sqrt(share)
    of_others = positive_part(team * mean - covariance_by_own_pose(by_pose_error, pose_error) / share)
    result: Array = of_others + own @ pose_error @ own.T
    return result


def _payload_by_pose_error(theta: Array) -> Array:
    """Return the derivative of ``(J, h, 1/m)`` by a rotation and translation ``(theta, p)`` of the payload, (10, 6)."""
    derivative = np.zeros((10, 6))
    tensor = unpack_symmetric(theta[:6])
    derivative[:6, :3] = pack_symmetric(CROSS_OF_AXES @ tensor - tensor @ CROSS_OF_AXES).T
    derivative[6:9, :3] = -skew(theta[6:9])
    derivative[6:9, 3:] = np.eye(3)
    return derivative

"""What is off for as long as samples are taken in: the frozen poses, and what dynamic consensus lags behind.

White noise averages out; these do not, so they enter the covariance by themselves (beyond Fan et al.). To first order,
poses of edges that are off by themselves act as if each robot stood a bit elsewhere in one frame that all share
(``coheft.consensus.graph.place_variances``). That does two things to what robot i finds: it sees the payload from its
wrong place, and the wrenches of all robots, each from a wrong place, add up to a wrong total.

A robot knows the poses of its own neighbours only: it takes all others to be like these.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coheft.estimation.geometry.spatial import CROSS_OF_AXES, Array, skew
from coheft.estimation.geometry.uncertain_pose import UncertainPose
from coheft.estimation.rigid_body.mass_properties import pack_symmetric, unpack_symmetric

_PLACE, _LAG, _POSES = slice(0, 6), slice(6, 7), slice(7, None)


def causes(neighbours: int) -> int:
    """How many numbers may be off: the own place (6), the lag (1), and the poses of all neighbours (6 each)."""
    return 7 + 6 * neighbours


def inputs_by_causes(wrench: Array, lag: Array, acceleration_by_poses: Array) -> Array:
    """By what a block's ``(F, T, a, alpha)`` are off for each unit of what may be off.

    Args:
        wrench: The robot's own ``(f, t)`` in ``F_i`` less the team's mean, shape (B, 6) [N, N·m]. What all places are
            off has the mean zero, so the mean wrench does not change by it.
        lag: What total wrench and angular acceleration may lag behind, shape (B, 9).
        acceleration_by_poses: See ``AngularAcceleration.by_poses``, shape (B, 3, 6 n).

    Returns:
        Shape (B, 12, 7 + 6 n). A place is off by ``(theta, p)``: by a turn, in the axes of ``F_i``, and a distance.
    """
    result = np.zeros((len(wrench), 12, causes(acceleration_by_poses.shape[2] // 6)))
    crosses = skew(wrench[:, :3])
    result[:, 0:3, 0:3] = -crosses
    result[:, 3:6, 0:3] = -skew(wrench[:, 3:])
    result[:, 3:6, 3:6] = -crosses
    result[:, 0:6, 6], result[:, 9:12, 6] = lag[:, :6], lag[:, 6:]
    result[:, 9:12, _POSES] = acceleration_by_poses
    return result


def place_covariance(poses: Sequence[UncertainPose], centre: Array, variance: float) -> Array:
    """Covariance (6, 6) of what a robot's place is off, ``(theta, p)`` at its own origin.

    Args:
        poses: Of its neighbours, ``pose_j_in_i``.
        centre: Where errors of all edges are compared, such as the middle of the payload in ``F_i``, shape (3,) [m].
        variance: Of its place, if that of every edge were 1.
    """
    at_centre = np.zeros((6, 6))
    for each in poses:
        carried = _carried(centre - each.pose.translation)
        at_centre += variance / len(poses) * carried @ each.covariance @ carried.T
    back = _carried(-centre)
    result: Array = back @ at_centre @ back.T
    return result


def _carried(distance: Array) -> Array:
    """What carries ``(theta, p)`` to a point that is so far away, shape (6, 6)."""
    result = np.eye(6)
    result[3:, :3] = -skew(distance)
    return result


def covariance_of_poses(
    theta: Array, by_causes: Array, place: Array, poses: Sequence[UncertainPose], team: int, sharing: int
) -> Array:
    """What frozen poses add to the covariance of white noise, for ``theta = (J, h, 1/m)``, shape (10, 10).

    Args:
        theta: The estimate, shape (10,).
        by_causes: What it is off for each unit of what may be off, shape (10, 7 + 6 n).
        place: See ``place_covariance``.
        poses: As they are in use, of all neighbours.
        team: Robots that hold the load; the wrenches of all add up.
        sharing: Robots over whose angular accelerations the mean is taken.
    """
    by_place, by_poses = by_causes[:, _PLACE], by_causes[:, _POSES]
    own = by_place - _payload_by_place(theta)
    result: Array = own @ place @ own.T + (team - 1) * by_place @ place @ by_place.T
    for k, pose in enumerate(poses):
        column = by_poses[:, 6 * k : 6 * k + 6]
        result += column @ pose.covariance @ column.T / sharing
    return result


def covariance_of_lag(by_causes: Array) -> Array:
    """What the lag adds to it, shape (10, 10)."""
    lag = by_causes[:, _LAG]
    result: Array = lag @ lag.T
    return result


def _payload_by_place(theta: Array) -> Array:
    """How ``(J, h, 1/m)`` changes when it is turned and moved as a whole, by ``(theta, p)``, shape (10, 6)."""
    derivative = np.zeros((10, 6))
    tensor = unpack_symmetric(theta[:6])
    derivative[:6, :3] = pack_symmetric(CROSS_OF_AXES @ tensor - tensor @ CROSS_OF_AXES).T
    derivative[6:9, :3] = -skew(theta[6:9])
    derivative[6:9, 3:] = np.eye(3)
    return derivative

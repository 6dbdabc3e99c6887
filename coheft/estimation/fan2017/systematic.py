"""What is off for as long as samples are taken in: the frozen poses, and what dynamic consensus lags behind.

White noise averages out; these do not, so they enter the covariance by themselves (beyond Fan et al.). What a pose is
off comes of the noise of the two robots' own sensors, and each robot's noise enters all of its edges alike. So to first
order poses are off as if each robot stood a bit elsewhere, and they close around cycles: what an edge is off is what
one end is, less what the other is. That does two things to what robot i finds: it sees the payload from its wrong
place, and the wrenches of all robots, each from a wrong place, add up to a wrong total.

A robot knows what its own place does to the estimate. All of these add up to what poses do, so robots find their mean
by consensus, as that of their estimates.
"""

from collections.abc import Sequence

import numpy as np

from coheft.estimation.geometry.spatial import CROSS_OF_AXES, Array, skew
from coheft.estimation.geometry.uncertain_pose import UncertainPose
from coheft.estimation.linear_algebra import positive_part
from coheft.estimation.rigid_body.mass_properties import pack_symmetric, unpack_symmetric


def inputs_by_place(wrench: Array, acceleration_by_place: Array) -> Array:
    """By what a block's ``(F, T, a, alpha)`` are off for each unit of what the own place is off.

    Args:
        wrench: The robot's own ``(f, t)`` in ``F_i`` less the team's mean, shape (B, 6) [N, N·m]. What all places are
            off has the mean zero, so the mean wrench does not change by it.
        acceleration_by_place: What angular acceleration is off by the own place, shape (B, 3, 6).

    Returns:
        Shape (B, 12, 6). A place is off by ``(theta, p)``: by a turn, in the axes of ``F_i``, and a distance.
    """
    result = np.zeros((len(wrench), 12, 6))
    crosses = skew(wrench[:, :3])
    result[:, 0:3, 0:3] = -crosses
    result[:, 3:6, 0:3] = -skew(wrench[:, 3:])
    result[:, 3:6, 3:6] = -crosses
    result[:, 9:12] = acceleration_by_place
    return result


def place_covariance(poses: Sequence[UncertainPose], centre: Array) -> Array:
    """Covariance (6, 6) of what a robot's place is off, ``(theta, p)`` at its own origin: half that of an edge.

    Args:
        poses: Of its neighbours, ``pose_j_in_i``.
        centre: Where errors of all edges are compared, such as the middle of the payload in ``F_i``, shape (3,) [m].
    """
    at_centre = np.zeros((6, 6))
    for each in poses:
        carried = place_carried(centre - each.pose.translation)
        at_centre += 0.5 / len(poses) * carried @ each.covariance @ carried.T
    back = place_carried(-centre)
    return back @ at_centre @ back.T


def place_carried(distance: Array) -> Array:
    """What carries ``(theta, p)`` to a point that is so far away, shape (6, 6)."""
    result = np.eye(6)
    result[3:, :3] = -skew(distance)
    return result


def covariance_of_place(by_place: Array, place: Array) -> Array:
    """What a robot's own place adds to the covariance of white noise, shape (10, 10).

    Args:
        by_place: What ``theta = (J, h, 1/m)`` is off for each unit of what the own place is off, shape (10, 6).
        place: See ``place_covariance``.
    """
    return by_place @ place @ by_place.T


def covariance_of_poses(theta: Array, by_place: Array, place: Array, mean: Array, team: int) -> Array:
    """What frozen poses add to the covariance of white noise for what a robot sees from its place, shape (10, 10).

    Args:
        theta: The estimate, shape (10,).
        by_place: What it is off for each unit of what the own place is off, shape (10, 6).
        place: See ``place_covariance``. Places of all robots are off by themselves, and only what they are off their
            mean counts.
        mean: Over all robots, of ``covariance_of_place``.
        team: Robots that hold the load.
    """
    # With C_j the derivative by the place of j, all of which add up to zero, S its covariance, P what a robot sees:
    # sum_j C_j S C_j^T - C_i S P^T - P S C_i^T + (1 - 1/N) P S P^T, as two squares.
    share = 1.0 - 1.0 / team
    own = np.sqrt(share) * _payload_by_place(theta) - by_place / np.sqrt(share)
    of_others = positive_part(team * mean - covariance_of_place(by_place, place) / share)
    result: Array = of_others + own @ place @ own.T
    return result


def _payload_by_place(theta: Array) -> Array:
    """How ``(J, h, 1/m)`` changes when it is turned and moved as a whole, by ``(theta, p)``, shape (10, 6)."""
    derivative = np.zeros((10, 6))
    tensor = unpack_symmetric(theta[:6])
    derivative[:6, :3] = pack_symmetric(CROSS_OF_AXES @ tensor - tensor @ CROSS_OF_AXES).T
    derivative[6:9, :3] = -skew(theta[6:9])
    derivative[6:9, 3:] = np.eye(3)
    return derivative

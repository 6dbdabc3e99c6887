"""Consensus over the robots' estimates (Fan et al., eqs 31, 32), and over the errors of these estimates."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from coheft.agents.estimator import Channels
from coheft.agents.fan2017.network import Network
from coheft.agents.fan2017.team_average import TeamAverage
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.mass_properties import packed_rotation

_PARAMETERS = 11
"""1/m, the constant 1 that makes points linear, h, J."""
_LAG = slice(_PARAMETERS, _PARAMETERS + 10)
"""Error of (J, h, 1/m) by the lag of the sums."""
_OLD = slice(_LAG.stop, _LAG.stop + 10)
"""Error by samples of another load, see ``JointRls.by_old``."""
_POSE_ERROR = slice(_OLD.stop, _OLD.stop + 100)
"""Covariance of theta due to the own pose error, see ``covariance_by_own_pose``."""
_CHANNELS = _POSE_ERROR.stop


@dataclass(frozen=True, eq=False)
class Agreed:
    """What robots agree on, in this robot's ``F_i``.

    Attributes:
        theta: ``(J, h, 1/m)`` [kg·m², m, 1/kg], J packed and about the centre of mass, shape (10,).
        behind: Difference between theta and the mean of all robots' thetas one block earlier, as the convergence rate
            gives it, shape (10,).
        by_lag: Error of theta by the lag of the sums, shape (10,).
        by_old: Error of theta by samples of another load, shape (10,).
        by_pose_error: Mean over all robots of ``covariance_by_own_pose``, shape (10, 10).
    """

    theta: Array
    behind: Array
    by_lag: Array
    by_old: Array
    by_pose_error: Array


class Agreement:
    """One robot's part in the consensus on parameters.

    Before the first estimate h is at the own grasp, so that the consensus on h is the centre of the grasps.

    Args:
        mass: Initial guess [kg].
    """

    def __init__(self, network: Network, mass: float) -> None:
        self._network = network
        self._own = self._mean = _channels(
            np.array([0.0] * 9 + [1.0 / mass]), np.zeros(10), np.zeros(10), np.zeros((10, 10))
        )
        self._behind = np.zeros(_CHANNELS)
        self.average = TeamAverage(network, "parameters", (1, 1, _CHANNELS), _transport)
        self.start({})

    def start(self, poses_j_in_i: Mapping[str, Pose]) -> None:
        """Start anew with these poses of the neighbours; what was agreed on holds until it has come as far again."""
        self.average.start(poses_j_in_i)
        self._left, self._before = self._own - self._mean, None

    def step(
        self, own: tuple[Array, Array, Array, Array] | None, inbox: Mapping[str, Channels], *, has_mixed: bool
    ) -> None:
        """Do one round.

        Args:
            own: The robot's theta in ``F_i``, its errors by the lag and by samples of another load, shape (10,) each,
                and its covariance due to the own pose error, shape (10, 10); None before there are any.
            inbox: What the neighbours sent.
            has_mixed: Whether there have been rounds enough since the start.
        """
        former, self._own = self._own, self._own if own is None else _channels(*own)
        mean = self.average.step(self._own[None], inbox)
        moved = self._own - former
        self._behind = self._behind + moved
        if mean is not None and self._before is not None:  # what all estimates move alike does not make them differ
            moved = moved - (mean[0] - self._before)
        self._left, self._before = self._network.rate * self._left + moved, None if mean is None else mean[0]
        if mean is not None and has_mixed:
            self._mean, self._behind = mean[0], self._left

    @property
    def centre(self) -> Array:
        """Mean of all h in ``F_i``, shape (3,) [m]."""
        return self._mean[2:5]

    @property
    def agreed(self) -> Agreed:
        """Return the agreed parameters and their errors, in ``F_i``."""
        by_pose_error = self._mean[_POSE_ERROR].reshape(10, 10)
        return Agreed(_theta(self._mean), _theta(self._behind), self._mean[_LAG], self._mean[_OLD], by_pose_error)


def turned(rotation: Array) -> Array:
    """Return the matrix that turns a difference of two theta, shape (10, 10)."""
    result = np.eye(10)
    result[:6, :6], result[6:9, 6:9] = packed_rotation(rotation), rotation
    return result


def _channels(theta: Array, by_lag: Array, by_old: Array, by_pose_error: Array) -> Array:
    return np.concatenate([theta[9:], [1.0], theta[6:9], theta[:6], by_lag, by_old, by_pose_error.ravel()])


def _theta(channels: Array) -> Array:
    return np.concatenate([channels[5:_PARAMETERS], channels[2:5], channels[:1]])


def _transport(pose_j_in_i: Pose) -> Array:
    """``X_ij`` of all channels. Where theta is a point that moves, its errors only turn."""
    turn = turned(pose_j_in_i.rotation)
    result = np.eye(_CHANNELS)
    result[2:5, 1] = pose_j_in_i.translation
    result[2:5, 2:5], result[5:_PARAMETERS, 5:_PARAMETERS] = turn[6:9, 6:9], turn[:6, :6]
    result[_LAG, _LAG] = result[_OLD, _OLD] = turn
    result[_POSE_ERROR, _POSE_ERROR] = np.kron(turn, turn)
    return result

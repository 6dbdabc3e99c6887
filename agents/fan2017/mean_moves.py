"""Dynamic consensus on the moves of the robots' estimates, from which each robot learns how noisy their mean is."""

from collections import deque
from collections.abc import Mapping

import numpy as np

from coheft.agents.estimator import Channels
from coheft.agents.fan2017.agreement import turned
from coheft.agents.fan2017.network import Network
from coheft.agents.fan2017.team_average import TeamAverage
from coheft.estimation.fan2017.joint_rls import JointRls
from coheft.estimation.fan2017.mean_noise import MeanNoise
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.linear_algebra import inverse

_CHANNELS = 11
"""The move of theta by a block, and 1 if the block was used."""


class MeanMoves:
    """One robot's part in this consensus.

    Args:
        network: The team as the robot sees it.
        rounds: Number of rounds per block.
        memory: Number of blocks over which estimates forget.
    """

    def __init__(self, network: Network, rounds: int, memory: float) -> None:
        self._network = network
        self._rounds = rounds
        self.noise = MeanNoise(memory)
        self.average = TeamAverage(network, "moves", (rounds, 1, _CHANNELS), _transport)
        self.start({})

    def start(self, poses_j_in_i: Mapping[str, Pose]) -> None:
        """Start anew, with the poses of the neighbours."""
        self.average.start(poses_j_in_i)
        self._gains: deque[Array | None] = deque(maxlen=self._rounds)

    def step(self, estimate: JointRls | None, is_new: bool, inbox: Mapping[str, Channels]) -> None:
        """Process a block.

        Args:
            estimate: The robot's own estimate, None if there is none yet.
            is_new: Whether it has just used a block.
            inbox: The neighbours' messages.
        """
        entering = np.zeros((1, _CHANNELS))
        if estimate is not None and is_new:
            entering[0] = np.append(estimate.moved, 1.0)
        mean = self.average.step(entering, inbox)
        gain_then = self._gains[0] if self._gains else None
        self._gains.append(None if estimate is None else estimate.gain)
        is_complete = mean is not None and mean[0, -1] > 1.0 - 0.5 / self._network.members
        if mean is not None and is_complete and estimate is not None and gain_then is not None:
            self.noise.measure(inverse(gain_then) @ mean[0, :-1], estimate)


def _transport(pose_j_in_i: Pose) -> Array:
    """Return ``X_ij`` (11, 11) of the channels ``(theta, 1)``: a difference of parameters is only turned."""
    result = np.eye(_CHANNELS)
    result[:-1, :-1] = turned(pose_j_in_i.rotation)
    return result

"""Consensus over what each block's noise does to the robots' estimates: how noisy their mean is."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from coheft.agents.estimator import Channels
from coheft.agents.fan2017.agreement import turned
from coheft.agents.fan2017.network import Network
from coheft.consensus.dynamic import DynamicConsensus
from coheft.estimation.fan2017.joint_rls import JointRls
from coheft.estimation.fan2017.mean_noise import MeanNoise
from coheft.estimation.geometry.spatial import Array, Pose

CHANNEL = "moves"
_CHANNELS = 11
"""What a block did to theta, and 1 where it was taken in."""


class MeanMoves:
    """One robot's share of it.

    Args:
        network: The team as the robot sees it.
        rounds: Rounds that each block goes through.
        memory: Blocks over which estimates forget.
    """

    def __init__(self, network: Network, rounds: int, memory: float) -> None:
        self._network = network
        self._rounds = rounds
        self.noise = MeanNoise(memory)
        self.start({})

    def start(self, poses_j_in_i: Mapping[str, Pose]) -> None:
        """Start anew with these poses of the neighbours."""
        self.consensus = DynamicConsensus(self._rounds, 1, _CHANNELS)
        self._transports = {name: _transport(pose) for name, pose in poses_j_in_i.items()}

    def step(self, estimate: JointRls | None, is_new: bool, inbox: Mapping[str, Channels]) -> None:
        """A block.

        Args:
            estimate: The robot's own, if there is one.
            is_new: Whether it has just taken in a block.
            inbox: What the neighbours sent.
        """
        entering = np.zeros((1, _CHANNELS))
        if estimate is not None and is_new:
            entering[0] = np.append(estimate.moved, 1.0)
        mean = self.consensus.step(entering, self._network.stages(CHANNEL, self._transports, inbox, self._rounds))
        if estimate is not None and mean is not None and mean[0, -1] > 1.0 - 0.5 / self._network.members:
            self.noise.measure(mean[0, :-1], estimate.noise_root, estimate.decay)


def _transport(pose_j_in_i: Pose) -> Array:
    """``X_ij`` of both: a difference of points only turns."""
    result = np.eye(_CHANNELS)
    result[:-1, :-1] = turned(pose_j_in_i.rotation)
    return result

"""A dynamic consensus in which one robot takes part: inputs enter, and the team's average leaves some blocks later."""

from collections.abc import Callable, Mapping

import numpy as np

from coheft.agents.estimator import Channels
from coheft.agents.fan2017.network import Network
from coheft.consensus.dynamic import DynamicConsensus
from coheft.estimation.geometry.spatial import Array, Pose


class TeamAverage:
    """One robot's part in the average of all robots' inputs.

    Args:
        network: The team as the robot sees it.
        channel: Name of its values in messages.
        shape: Number of rounds K, samples per block B, and channels per sample C.
        transport: Returns ``X_ij`` (C, C) of a neighbour from ``pose_j_in_i``.

    Attributes:
        before_last_round: What left in the last step as it was before its last round, shape (B, C).
    """

    def __init__(
        self, network: Network, channel: str, shape: tuple[int, int, int], transport: Callable[[Pose], Array]
    ) -> None:
        self._network, self._channel, self._shape, self._transport = network, channel, shape, transport
        self.start({})

    def start(self, poses_j_in_i: Mapping[str, Pose]) -> None:
        """Start anew, with these poses of the neighbours."""
        self._consensus = DynamicConsensus(*self._shape)
        self._transports = {name: self._transport(pose) for name, pose in poses_j_in_i.items()}

    def step(self, inputs: Array, inbox: Mapping[str, Channels]) -> Array | None:
        """Enter a block (B, C), and return the average of the one that entered K blocks ago, None if incomplete."""
        self.before_last_round = self._consensus.pipeline.stages[-1]
        stages = self._network.stages(self._channel, self._transports, inbox, self._shape[0])
        return self._consensus.step(inputs, stages)

    def miss_block(self) -> None:
        """Process that a block was missed: what has entered is incomplete."""
        self._consensus.pipeline.clear()

    @property
    def is_broken(self) -> bool:
        """Whether a value was lost, so that every robot has to start anew."""
        return self._consensus.is_broken

    def channels(self) -> dict[str, Array]:
        """Return what to send to the neighbours."""
        stages, valid = self._consensus.pipeline.sent()
        return {self._channel: stages, f"{self._channel}_valid": valid.astype(np.float64)}

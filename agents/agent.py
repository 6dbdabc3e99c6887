"""One robot's agent as a pure core: measurements and messages in, messages and references out.

No clock, no socket, no thread. The same core runs in a process of its own over Zenoh and, with many others, on a
simulated network in one process; equal inputs give equal outputs, bit for bit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from agents.efficient import EfficientEstimator
from agents.estimator import EstimatorFactory
from agents.motion import make_motion
from agents.seed import SeedEstimator
from coheft.estimation.measurement import MeasurementBlock
from coheft.wire.config import AgentConfig
from coheft.wire.messages import Estimate, NeighbourMessage, PoseEstimate, Reference
from consensus.gossip import Gossip

ESTIMATORS: dict[str, EstimatorFactory] = {"efficient": EfficientEstimator, "seed": SeedEstimator}

_REPORT_INTERVAL = 0.1
"""Time between reports to observers [s]."""


@dataclass(frozen=True, eq=False)
class Outbox:
    """What an agent sends after a block: to all its neighbours, to the server, and now and then to observers."""

    message: NeighbourMessage
    reference: Reference
    estimate: Estimate | None


class Agent:
    """One robot.

    Args:
        config: All that it is told.
    """

    def __init__(self, config: AgentConfig) -> None:
        self.config = config
        self._gossip = Gossip(config.name, config.neighbours)
        self._estimator = ESTIMATORS[config.estimator](config, self._gossip)
        self._motion = make_motion(config.motion, config.seed, config.rate, config.block)
        self._report_every = max(1, round(_REPORT_INTERVAL * config.rate / config.block))
        self._next = 0

    def step(self, block: MeasurementBlock | None, inbox: Mapping[str, NeighbourMessage]) -> Outbox:
        """One block.

        Args:
            block: The robot's measurements, None if they are unusable.
            inbox: What the neighbours sent after the previous block, by name.
        """
        index = self._next
        self._next += 1
        for name in sorted(inbox):
            self._gossip.hear(inbox[name].gossip)
        channels = self._estimator.step(index, block, {name: message.channels for name, message in inbox.items()})
        return Outbox(
            message=NeighbourMessage(
                sender=self.config.name, block=index, gossip=self._gossip.news(), channels=channels
            ),
            reference=Reference(
                robot=self.config.name,
                block=index + self.config.lag,
                answers=index,
                motion=self._motion.reference(index + self.config.lag),
                wrench=np.zeros(6),
            ),
            estimate=self._estimate(index) if self._next % self._report_every == 0 else None,
        )

    def _estimate(self, index: int) -> Estimate:
        belief = self._estimator.belief()
        graph = self._gossip.graph
        return Estimate(
            robot=self.config.name,
            block=index,
            time=(index + 1) * self.config.block / self.config.rate,
            phase=belief.phase,
            converged=belief.converged,
            members=0 if graph is None else len(graph),
            payload=belief.payload,
            poses={
                name: PoseEstimate(pose.pose.rotation, pose.pose.translation, pose.covariance)
                for name, pose in belief.poses.items()
            },
            total_block=belief.total_block,
            total_wrench=belief.total_wrench,
            not_observable=list(belief.not_observable),
            load_changes=list(belief.load_changes),
        )

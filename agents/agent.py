"""One robot's agent as a pure core: measurements and messages in, messages and references out.

No clock, no socket, no thread. The same core runs in a process of its own over Zenoh and, with many others, on a
simulated network in one process; equal inputs give equal outputs, bit for bit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from coheft.agents.efficient.estimator import EfficientEstimator
from coheft.agents.estimator import Belief, Estimator, EstimatorFactory
from coheft.agents.fan2017.estimator import Fan2017Estimator
from coheft.agents.inbox import NeighbourInbox
from coheft.agents.motion.carrier import Carrier
from coheft.agents.motion.reference import make_motion
from coheft.agents.plugins.estimator import OwnEstimator
from coheft.agents.plugins.loading import make_own
from coheft.agents.sensor_check import SensorCheck
from coheft.agents.status import StatusKeeper
from coheft.consensus.gossip import Gossip
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import MeasurementBlock
from coheft.wire.config import AgentConfig
from coheft.wire.messages.size import LARGEST
from coheft.wire.messages.structs import Estimate, NeighbourMessage, Reference

ESTIMATORS: dict[str, EstimatorFactory] = {"efficient": EfficientEstimator, "fan2017": Fan2017Estimator}
"""Those that come with coheft; others are found by their entry points, see ``coheft.wire.scenario.plugins``."""

_SILENT = 2
"""A neighbour of which so many messages in a row are missing is silent."""


@dataclass(frozen=True, eq=False)
class Outbox:
    """Messages of an agent after a block: to its neighbours, to the server, and sometimes to observers.

    ``problems`` is what it refused in this step, in words.
    """

    message: NeighbourMessage
    reference: Reference
    estimate: Estimate | None
    problems: tuple[str, ...] = ()


def make_estimator(config: AgentConfig, gossip: Gossip, largest_arrays: int) -> Estimator:
    """Make the estimator that an agent is configured to use.

    Args:
        config: Of the agent.
        gossip: What it learns of the team.
        largest_arrays: What one of the user's own may send in one message [B].

    Raises:
        PluginError: It is one of the user's own, and cannot be used.
    """
    factory = ESTIMATORS.get(config.estimator)
    if factory is not None:
        return factory(config, gossip)
    own: Estimator = make_own("estimator", config.estimator, Estimator, config, gossip)
    return OwnEstimator(own, config, gossip, largest_arrays)


class Agent:
    """One robot.

    Args:
        config: All that it is told.
        incarnation: Larger than that of any agent of the same name before.
        largest_arrays: What an estimator of the user's own may send in one message [B].

    Raises:
        PluginError: An estimator or a motion of the user's own cannot be used.
    """

    def __init__(self, config: AgentConfig, incarnation: int = 0, largest_arrays: int = LARGEST) -> None:
        self.config = config
        self._incarnation = incarnation
        self._gossip = Gossip(config.name, config.neighbours, incarnation)
        self._estimator = make_estimator(config, self._gossip, largest_arrays)
        self._motion = make_motion(config)
        self._carrier = None if config.carry is None else Carrier(config, config.carry, self._motion)
        self._inbox = NeighbourInbox(config.neighbours)
        self._sensors = SensorCheck(config.noise)
        self._status = StatusKeeper(config)

    def set_holding(self, holding: bool, from_block: int) -> None:
        """Record that the robot grasps or releases the load, at a block that has not been stepped yet."""
        self._gossip.announce_holding(holding, from_block)

    def belief(self) -> Belief:
        """The present estimate, whether or not it may be published."""
        return self._estimator.belief()

    def step(self, index: int, block: MeasurementBlock | None, inbox: Sequence[NeighbourMessage]) -> Outbox:
        """One block.

        Args:
            index: Its number; grows from step to step, by one if nothing was missed. The first one may be any.
            block: The robot's measurements, None if there are none.
            inbox: All that has come from neighbours since the last step, whatever it is.

        Raises:
            PluginError: An estimator or a motion of the user's own has failed.
        """
        heard, gossip, problems = self._inbox.take(index, inbox, self._estimator.fits)
        self._gossip.hear(gossip)
        if block is not None and not self._sensors.is_usable(block.samples):
            block = None
        channels = self._estimator.step(index, block, {name: message.channels for name, message in heard.items()})
        self._status.problems += len(problems)
        estimate = self._estimate(index)
        motion, wrench = self._reference(index, block)
        return Outbox(
            message=NeighbourMessage(
                sender=self.config.name,
                block=index,
                gossip=self._gossip.news(),
                channels=channels,
                incarnation=self._incarnation,
            ),
            reference=Reference(
                robot=self.config.name,
                block=index + self.config.lag,
                answers=index,
                motion=motion,
                wrench=wrench,
            ),
            estimate=estimate,
            problems=tuple(problems),
        )

    def _reference(self, index: int, block: MeasurementBlock | None) -> tuple[Array, Array]:
        """What the arm shall do ``lag`` blocks later: ``motion`` and ``wrench`` of a ``Reference``."""
        if self._carrier is None:
            return self._motion.reference(index + self.config.lag), np.zeros(6)
        return self._carrier.step(index, None if block is None else block.samples)

    def _estimate(self, index: int) -> Estimate | None:
        """A report, if one is due."""
        doubts = list(self._doubts(index))
        if not self._status.is_due(index, doubts):
            return None
        belief = self.belief()
        graph = self._gossip.graph
        members = 0 if graph is None else len(graph)
        estimate = self._status.report(index, belief, doubts, members, self._silent(index))
        if self._carrier is not None:
            self._carrier.learn(index, estimate, belief.grasps)
        return estimate

    def _silent(self, index: int) -> list[str]:
        """Neighbours that are not heard."""
        return [name for name in self.config.neighbours if index - self._inbox.last_heard(name) >= _SILENT]

    def _doubts(self, index: int) -> Iterator[str]:
        if self._sensors.fault is not None:
            yield f"own sensors: {self._sensors.fault}"
        for name in self._silent(index):
            since = self.config.start_of(self._inbox.last_heard(name) + 1)
            yield f"{name} is silent since {since:.2f} s"
        yield from self._estimator.doubts()
        if not self._gossip.own.holding:
            yield "the robot does not hold the load"
        elif self._gossip.graph is None:
            missing = self._gossip.unknown() or ["it is not connected, or no other robot holds the load"]
            yield f"the team is not known: {', '.join(missing)}"

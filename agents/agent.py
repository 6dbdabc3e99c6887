"""One robot's agent as a pure core: takes measurements and messages, returns messages and references.

It uses no clock, socket or thread. The same core runs in a process of its own over Zenoh, or with many others on a
simulated network in one process; equal inputs give equal outputs, bit for bit.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace

from coheft.agents.efficient.estimator import EfficientEstimator
from coheft.agents.estimator import Belief, Estimator, EstimatorFactory, RowSigner, SignsRows, TakesLate
from coheft.agents.fan2017.estimator import Fan2017Estimator
from coheft.agents.inbox import NeighbourInbox
from coheft.agents.motion.carrier import Carrier
from coheft.agents.motion.reference import make_motion
from coheft.agents.network import SimulatedNetwork
from coheft.agents.plugins.estimator import OwnEstimator
from coheft.agents.plugins.loading import make_own
from coheft.agents.sensor_check import SensorCheck
from coheft.agents.side_by_side import SideBySide
from coheft.agents.status import StatusKeeper
from coheft.consensus.gossip import Gossip
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import MeasurementBlock
from coheft.wire.config import AgentConfig
from coheft.wire.messages.size import LARGEST
from coheft.wire.messages.structs import Estimate, EstimateBeside, NeighbourMessage, Reference
from coheft.wire.scenario.network import LinkQuality
from coheft.wire.scenario.plugins import estimator_names

ESTIMATORS: dict[str, EstimatorFactory] = {"efficient": EfficientEstimator, "fan2017": Fan2017Estimator}
"""The estimators that come with coheft; others are found by entry points, see ``coheft.wire.scenario.plugins``."""

_SILENT_AFTER = 2
"""Number of consecutive missing messages after which a neighbour is reported as silent."""


@dataclass(frozen=True, eq=False)
class Outbox:
    """An agent's messages after a block: to its neighbours, to the server, and sometimes to observers.

    ``problems`` describes what the agent refused in this step; ``beside`` are estimates of further estimators.
    """

    message: NeighbourMessage
    reference: Reference
    estimate: Estimate | None
    problems: tuple[str, ...] = ()
    beside: tuple[EstimateBeside, ...] = ()


def make_estimator(config: AgentConfig, gossip: Gossip, largest_arrays: int) -> Estimator:
    """Make the estimator that the agent's configuration names, or all of them side by side.

    A user's estimator may send ``largest_arrays`` [B] in one message.

    Raises:
        PluginError: A user's estimator cannot be used.
    """
    made: dict[str, Estimator] = {}
    for name in (names := estimator_names(config.estimator)):
        own = replace(config, estimator=name, estimator_settings=config.estimator_settings.get(name, {}))
        if name in ESTIMATORS:
            made[name] = ESTIMATORS[name](own, gossip)
        else:
            users = make_own("estimator", name, Estimator, own, gossip)
            made[name] = OwnEstimator(users, own, gossip, largest_arrays // len(names))
    return made[names[0]] if len(names) == 1 else SideBySide(made)


class Agent:
    """One robot's agent.

    Args:
        config: All that the agent knows at the start.
        incarnation: A number larger than that of any earlier agent of the same name.
        largest_arrays: Size that a user's estimator may send in one message [B].
        signer: Signs measurements in the secure profile, None in the open one.

    Raises:
        PluginError: A user's estimator or motion cannot be used.
    """

    def __init__(
        self,
        config: AgentConfig,
        incarnation: int = 0,
        largest_arrays: int = LARGEST,
        signer: RowSigner | None = None,
    ) -> None:
        self.config = config
        self._incarnation = incarnation
        self._gossip = Gossip(config.name, config.neighbours, incarnation)
        self._largest_arrays, self._signer = largest_arrays, signer
        self._start_estimator()
        self._motion = make_motion(config)
        self._carrier = None if config.carry is None else Carrier(config, config.carry, self._motion)
        self._network = SimulatedNetwork(config)
        self._inbox = NeighbourInbox(config.neighbours)
        own = config.sensors_of(config.name)
        self._sensors, self._is_missing = SensorCheck(own.noise), own.is_missing() if own.missing else None
        first, *others = estimator_names(config.estimator)
        self._status = StatusKeeper(replace(config, estimator=first))
        self._beside = {name: StatusKeeper(replace(config, estimator=name)) for name in others}

    def _start_estimator(self) -> None:
        """Make an estimator that knows nothing yet."""
        self._estimator = make_estimator(self.config, self._gossip, self._largest_arrays)
        self._receives_late = self._estimator if isinstance(self._estimator, TakesLate) else None
        self._signing: SignsRows | None = None
        if self._signer is not None and isinstance(self._estimator, SignsRows):
            self._signing = self._estimator
            self._signing.sign_with(self._signer)

    def set_holding(self, holding: bool, from_block: int) -> None:
        """Record that the robot grasps or releases the load, from a block that has not been processed yet."""
        self._gossip.announce_holding(holding, from_block)

    def set_link(self, neighbour: str, quality: LinkQuality) -> None:
        """Let messages of a neighbour be lost or late from now on."""
        self._network.set_link(neighbour, quality)

    def belief(self) -> Belief:
        """Return the present estimate of the robot's own estimator, whether or not it may be published."""
        return self._estimator.belief()

    def step(self, index: int, block: MeasurementBlock | None, inbox: Sequence[NeighbourMessage]) -> Outbox:
        """Process one block.

        Args:
            index: The block's number. It grows with every step, by one unless blocks were missed; the first may be any.
            block: The robot's measurements, None if there are none.
            inbox: All messages received from neighbours since the last step.

        Raises:
            PluginError: A user's estimator or motion has failed.
        """
        arrived = self._network.deliver(index, inbox)
        received, gossip, problems, late = self._inbox.take(
            index, arrived, self._estimator.fits, takes_late=self._receives_late is not None
        )
        self._gossip.hear(gossip)
        if self._receives_late is not None:
            for message in late:
                self._receives_late.receive_late(message.sender, message.channels)
        if block is not None and self._is_missing is not None:
            block = MeasurementBlock(index, np.where(self._is_missing, 0.0, block.samples))
        if block is not None and not self._sensors.is_usable(block.samples):
            block = None
        self._status.problems += len(problems)
        channels = dict[str, Array]()
        estimate, beside = None, tuple[EstimateBeside, ...]()
        try:
            channels = self._estimator.step(
                index, block, {name: message.channels for name, message in received.items()}
            )
            if self._signing is not None:
                refused = self._signing.refused()
                problems += refused
                self._status.problems += len(refused)
            estimate, beside = self._estimate(index), tuple(self._estimates_beside(index))
        except np.linalg.LinAlgError as error:  # what neighbours send may be possible, but not fit together
            problems.append(f"the estimates so far cannot be computed with ({error}), so the estimator starts again")
            self._status.problems += 1
            self._start_estimator()
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
            beside=beside,
        )

    def _reference(self, index: int, block: MeasurementBlock | None) -> tuple[Array, Array]:
        """Return what the arm shall do ``lag`` blocks later: ``motion`` and ``wrench`` of a ``Reference``."""
        if self._carrier is None:
            return self._motion.reference(index + self.config.lag), np.zeros(6)
        return self._carrier.step(index, None if block is None else block.samples)

    def _estimate(self, index: int) -> Estimate | None:
        """Return a report for observers, if one is due."""
        doubts = list(self._doubts(index, self._estimator.doubts()))
        if not self._status.is_due(index, doubts):
            return None
        belief = self.belief()
        estimate = self._status.report(index, belief, doubts, len(self._gossip.graph or ()), self._silent(index))
        if self._carrier is not None:
            self._carrier.learn(index, estimate, belief.grasps)
        return estimate

    def _estimates_beside(self, index: int) -> Iterator[EstimateBeside]:
        if not isinstance(self._estimator, SideBySide):
            return
        for name, status in self._beside.items():
            doubts = list(self._doubts(index, self._estimator.doubts_of(name)))
            if status.is_due(index, doubts):
                belief, members = self._estimator.belief_of(name), len(self._gossip.graph or ())
                yield EstimateBeside(status.report(index, belief, doubts, members, self._silent(index)))

    def _silent(self, index: int) -> list[str]:
        """Return the neighbours whose messages are missing."""
        return [name for name in self.config.neighbours if index - self._inbox.last_heard(name) >= _SILENT_AFTER]

    def _doubts(self, index: int, of_estimator: Sequence[str]) -> Iterator[str]:
        if self._sensors.fault is not None:
            yield f"own sensors: {self._sensors.fault}"
        for name in self._silent(index):
            since = self.config.start_of(self._inbox.last_heard(name) + 1)
            yield f"{name} is silent since {since:.2f} s"
        yield from of_estimator
        if not self._gossip.own.holding:
            yield "the robot does not hold the load"
        elif self._gossip.graph is None:
            missing = self._gossip.unknown() or ["it is not connected, or no other robot holds the load"]
            yield f"the team is not known: {', '.join(missing)}"

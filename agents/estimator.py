"""The interface of estimators, which turn an agent's measurements and messages into beliefs.

To add an estimator, write a class with the methods of ``Estimator``. In your own package, register it as an entry point
(docs/own.md); ``coheft.agents.plugins.estimator`` checks what its methods return. In this package, add it to
``coheft.agents.agent.ESTIMATORS``, ``coheft.wire.scenario.plugins.BUILT_IN`` and ``coheft.wire.messages.size.ARRAYS``.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from coheft.consensus.gossip import Gossip
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.geometry.uncertain_pose import UncertainPose
from coheft.estimation.measurement import MeasurementBlock
from coheft.estimation.rigid_body.mass_properties import TIMES_IN_MATRIX
from coheft.wire.config import AgentConfig
from coheft.wire.messages.structs import LoadChangeNotice, PayloadEstimate, SensorErrorEstimate, SlipNotice
from coheft.wire.scenario.estimator_settings import Converged

Channels = Mapping[str, npt.NDArray[Any]]
"""Arrays by name. Measurements are in the sender's grasp frame; sums of the team are in a frame that the team
selects."""


MOST_NOTICES = 32
"""So many of the newest load changes, and of the newest slips, are reported: messages must not grow without limit."""


@dataclass(frozen=True, eq=False)
class Belief:
    """An estimate. Fields as in ``coheft.wire.messages.structs.Estimate``, and:

    Attributes:
        learned_block: The newest block that has been processed, -1 if there is none.
        grasps: Pose of every member's ``F_j`` in the frame that the team shares; empty until it is known well, or if
            the method has no such frame.
        shortfall: Reasons why the estimate has not converged, although there is a payload.
    """

    phase: Literal["poses", "inertia"]
    converged: bool
    payload: PayloadEstimate | None
    poses: Mapping[str, UncertainPose]
    total_block: int = -1
    total_wrench: Array = field(default_factory=lambda: np.zeros(6))
    not_observable: tuple[str, ...] = ()
    load_changes: tuple[LoadChangeNotice, ...] = ()
    learned_block: int = -1
    grasps: Mapping[str, Pose] = field(default_factory=dict)
    sensor_errors: tuple[SensorErrorEstimate, ...] = ()
    shortfall: tuple[str, ...] = ()
    slips: tuple[SlipNotice, ...] = ()


class Estimator(Protocol):
    """One robot's estimator. Deterministic: equal inputs give equal outputs, bit for bit."""

    def step(
        self, index: int, own: MeasurementBlock | None, inbox: Mapping[str, Channels]
    ) -> dict[str, npt.NDArray[Any]]:
        """Process one block.

        Args:
            index: The block's number.
            own: The robot's measurements, None if they are unusable.
            inbox: What each neighbour sent after the previous block; neighbours without a message are left out.

        Returns:
            Arrays to send to all neighbours.
        """
        ...

    def fits(self, channels: Channels) -> bool:
        """Whether the next step can read a neighbour's arrays, judged by their shapes."""
        ...

    def belief(self) -> Belief:
        """Return the estimate after the last step."""
        ...

    def doubts(self) -> tuple[str, ...]:
        """Return reasons why the estimate may no longer be valid; called after every step."""
        ...


@runtime_checkable
class TakesLate(Protocol):
    """An estimator that can also use messages of earlier blocks than the one before."""

    def receive_late(self, sender: str, channels: Channels) -> None:
        """Take a message that a neighbour sent after an earlier block; called before the next ``step``."""
        ...


class RowSigner(Protocol):
    """Signs as one robot of a run, and checks signatures of the others."""

    def sign(self, content: bytes) -> bytes:
        """Return this robot's signature."""
        ...

    def is_signed_by(self, robot: str, content: bytes, signature: bytes) -> bool:
        """Whether this robot of the same run has signed the content."""
        ...


@runtime_checkable
class SignsRows(Protocol):
    """An estimator that forwards measurements of third robots, and can have them signed."""

    def sign_with(self, signer: RowSigner) -> None:
        """Sign this robot's measurements, and use only those of others that they have signed."""
        ...

    def refused(self) -> list[str]:
        """Return what was refused since the last call for lack of a right signature, in words."""
        ...


EstimatorFactory = Callable[[AgentConfig, Gossip], Estimator]
"""Makes an estimator from the agent's configuration and its knowledge of the team."""


def is_converged(payload: PayloadEstimate, limits: Converged) -> bool:
    """Whether all parameters are known, with standard deviations within a scenario's limits."""
    if payload.com is None or payload.tensor is None:
        return False
    deviations = np.sqrt(payload.covariance.diagonal())
    inertia_deviation = inertia_std(payload.covariance)
    return bool(
        100.0 * deviations[0] <= limits.mass_percent * payload.mass
        and 1e3 * deviations[1:4].max() <= limits.com_mm
        and 100.0 * inertia_deviation <= limits.inertia_percent * np.linalg.norm(payload.tensor)
    )


def inertia_std(covariance: Array) -> float:
    """Return the root mean square error of the inertia in the Frobenius norm, from the covariance of ``(m, h, J
    packed)``.
    """
    return math.sqrt(max(0.0, float(TIMES_IN_MATRIX @ covariance.diagonal()[4:])))

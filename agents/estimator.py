"""The interface of estimators, which turn an agent's measurements and messages into beliefs.

To add one: write a class with the methods of ``Estimator``. In a package of your own it gets its name by an entry
point, see docs/own.md, and ``coheft.agents.plugins.estimator`` checks what its methods return. In this one it gets it
in ``coheft.agents.agent.ESTIMATORS``, ``coheft.wire.scenario.plugins.SECTIONS`` and
``coheft.wire.messages.size.ARRAYS``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

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
"""Arrays by name; what an agent measured is in its own grasp frame, what the team sums in a frame of its choice."""


@dataclass(frozen=True, eq=False)
class Belief:
    """An estimate; fields as in ``coheft.wire.messages.structs.Estimate``, and:

    Attributes:
        learned_block: The newest block that has been looked at, -1 if there is none.
        grasps: Pose of every member's ``F_j`` in the frame that the team shares; none while it is not known well, or
            where the method has no such frame.
        shortfall: Why it has not converged, though there is a payload.
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
        """One block.

        Args:
            index: Its number.
            own: The robot's measurements, None if they are unusable.
            inbox: What each neighbour sent after the previous block; neighbours whose message is missing are left out.

        Returns:
            What to send to all neighbours.
        """
        ...

    def fits(self, channels: Channels) -> bool:
        """Whether a neighbour's arrays have shapes that the next step can read."""
        ...

    def belief(self) -> Belief:
        """What is believed after the last step."""
        ...

    def doubts(self) -> tuple[str, ...]:
        """Reasons why the belief may no longer hold; called after every step."""
        ...


class EstimatorFactory(Protocol):
    """Makes an estimator from the agent's settings and its knowledge of the team."""

    def __call__(self, config: AgentConfig, gossip: Gossip) -> Estimator:  # noqa: D102
        ...


def is_converged(payload: PayloadEstimate, limits: Converged) -> bool:
    """Whether all is known, and all standard deviations are within a scenario's limits."""
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
    """Root mean square of the inertia's error in the Frobenius norm, of a covariance of ``(m, h, J packed)``."""
    return math.sqrt(max(0.0, float(TIMES_IN_MATRIX @ covariance.diagonal()[4:])))

"""Comparison of a robot's estimate with the truth."""

from __future__ import annotations

import bisect
from collections.abc import Iterable, Mapping
from enum import StrEnum
from typing import Self

import msgspec
import numpy as np

from coheft.app.results.errors import MOST_STDS, PAYLOAD_PARTS, in_stds, payload_error, pose_error
from coheft.app.results.states import State
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.mass_properties import Inertia, unpack_symmetric
from coheft.wire.messages.structs import Estimate, PayloadEstimate, SensorErrorEstimate, Validity
from coheft.wire.messages.truth import Scene, Truth

RECOVERED_MASS_PCT = 3.0
RECOVERED_COM_MM = 20.0

Matrix = list[list[float]]


class MassReport(msgspec.Struct, frozen=True):
    """Mass [kg]; ``std`` is the robot's own standard deviation, ``error_pct`` relative to the truth."""

    truth: float
    estimate: float | None = None
    std: float | None = None
    error_pct: float | None = None


class ComReport(msgspec.Struct, frozen=True):
    """Centre of mass in the robot's grasp frame [m]; ``std`` per axis, ``error_mm`` the distance to the truth."""

    truth: list[float]
    estimate: list[float] | None = None
    std: list[float] | None = None
    error_mm: float | None = None


class InertiaReport(msgspec.Struct, frozen=True):
    """Inertia about the centre of mass in the axes of the robot's grasp frame [kg·m²].

    ``std`` per entry, ``error_pct`` the Frobenius norm of the error relative to that of the truth.
    """

    truth: Matrix
    estimate: Matrix | None = None
    std: Matrix | None = None
    error_pct: float | None = None


class PoseReport(msgspec.Struct, frozen=True):
    """Error of a neighbour's grasp pose: angle of rotation [degrees], distance [mm]."""

    rotation_error_deg: float
    translation_error_mm: float

    @classmethod
    def of(cls, error: Array) -> Self:
        """Make it from ``errors.pose_error``."""
        rotation, translation = np.linalg.norm(error.reshape(2, 3), axis=1).tolist()
        return cls(float(np.degrees(rotation)), 1e3 * translation)


class Contradiction(msgspec.Struct, frozen=True):
    """An error of a valid estimate that its own standard deviation rules out.

    Attributes:
        quantity: ``mass``, ``centre of mass``, ``inertia``, or ``pose of NAME``.
        stds: Largest error of its components, in their own standard deviations; more than 4.
    """

    quantity: str
    stds: float


class Verdict(StrEnum):
    """Result of comparing an estimate, or those of all robots, with the truth; the worst first."""

    CONTRADICTED = "further off than it claims"
    NOT_CONVERGED = "not converged"
    CONVERGED = "converged"


class RobotReport(msgspec.Struct, frozen=True):
    """One robot's estimate at one time.

    Attributes:
        poses: Errors of the neighbours' grasp poses; empty while the robot is still finding them.
        converged_at_s: When it first did with its present estimator [s]; None if never.
        not_observable: Parameters that it reports as not observable from the motion so far.
        status: The status that it reports: ``starting``, ``valid``, or ``stale`` if the estimate may have become
            invalid.
        contradictions: Errors beyond four of its own standard deviations, while it reports a valid estimate.
    """

    time_s: float
    mass: MassReport
    com: ComReport
    inertia: InertiaReport
    poses: dict[str, PoseReport]
    converged: bool
    converged_at_s: float | None
    not_observable: list[str]
    status: Validity = Validity.STARTING
    reasons: list[str] = []
    state: State = State.FINDING_NEIGHBOURS
    sensor_errors: list[SensorErrorEstimate] = []
    contradictions: list[Contradiction] = []

    def as_of_now(self, belief: Estimate) -> RobotReport:
        """Return this report with the robot's present status: it may have become silent since."""
        is_valid = belief.status is Validity.VALID
        return msgspec.structs.replace(
            self,
            status=belief.status,
            reasons=belief.reasons,
            state=State.of(belief),
            contradictions=self.contradictions if is_valid else [],
        )

    @property
    def verdict(self) -> Verdict:
        """Whether the robot has converged, by its own report and by the truth."""
        if self.contradictions:
            return Verdict.CONTRADICTED
        return Verdict.CONVERGED if self.converged and self.status is Validity.VALID else Verdict.NOT_CONVERGED


class Judge:
    """Compares estimates with the truth in every robot's grasp frame; truths are in order of blocks."""

    def __init__(self, scene: Scene, truths: Iterable[Truth] = ()) -> None:
        self.scene = scene
        self._pose_payload_in = {
            name: Pose(rotation, translation).inverse()
            for name, rotation, translation in zip(scene.robots, scene.rotations, scene.translations, strict=True)
        }
        self._truths = list(truths)

    def add(self, truth: Truth, *, remember: int) -> None:
        """Add the truth of one more block; at least the newest ``remember`` truths are kept."""
        self._truths.append(truth)
        if len(self._truths) >= 2 * remember:
            del self._truths[:-remember]

    def truth_at(self, block: int) -> Truth:
        """Return the truth of a block, or else of the last known block before it, or else the oldest one."""
        after = bisect.bisect_right(self._truths, block, key=lambda truth: truth.block)
        return self._truths[max(0, after - 1)]

    def pose_payload_in(self, robot: str, block: int) -> Pose:
        """Return the pose of the payload's frame in the robot's in a block; it changes when the grasp slips."""
        slipped = self.truth_at(block).slipped.get(robot) if self._truths else None
        if slipped is None:
            return self._pose_payload_in[robot]
        return Pose(slipped.rotation, slipped.translation).inverse()

    def payload(self, robot: str, block: int) -> Inertia:
        """Return the true payload of a block in the robot's frame."""
        truth = self.truth_at(block).payload
        return Inertia(truth.mass, truth.com, truth.tensor).transported(self.pose_payload_in(robot, block))

    def total_wrench(self, robot: str, block: int) -> Array | None:
        """Return the true total wrench (6,) at the last sample of a block about the robot's origin; None if unknown."""
        truth = self.truth_at(block)
        if truth.block != block:
            return None
        wrench: Array = self.pose_payload_in(robot, block).adjoint() @ truth.total_wrench
        return wrench

    def relative_pose(self, robot: str, neighbour: str, block: int = -1) -> Pose:
        """Return the neighbour's true pose in the robot's frame, ``pose_j_in_i``, in a block."""
        return self.pose_payload_in(robot, block) @ self.pose_payload_in(neighbour, block).inverse()

    def pose_errors(self, estimate: Estimate, block: int | None = None) -> dict[str, Array]:
        """Return the errors of the neighbours' poses that the robot has found, by name, see ``errors.pose_error``; with
        the truth of the block that the robot had processed, or of another one.
        """
        if estimate.phase != "inertia":
            return {}
        block = estimate.block if block is None else block
        return {
            name: pose_error(self.relative_pose(estimate.robot, name, block), pose)
            for name, pose in estimate.poses.items()
        }

    def robot(self, estimate: Estimate, converged_at: float | None = None) -> RobotReport:
        """Return the report of a robot's estimate, and of the time [s] at which the robot first converged."""
        mass, com, inertia = _compared(self.payload(estimate.robot, estimate.block), estimate.payload)
        return RobotReport(
            time_s=estimate.time,
            mass=mass,
            com=com,
            inertia=inertia,
            poses={name: PoseReport.of(error) for name, error in self.pose_errors(estimate).items()},
            converged=estimate.converged,
            converged_at_s=converged_at,
            not_observable=list(estimate.not_observable),
            status=estimate.status,
            reasons=list(estimate.reasons),
            state=State.of(estimate),
            sensor_errors=list(estimate.sensor_errors),
            contradictions=self.contradictions(estimate),
        )

    def in_stds(self, estimate: Estimate) -> dict[str, Array]:
        """Return the errors of each quantity in the estimate's own standard deviations, as in ``Contradiction``.

        They are of the block to which the estimate belongs.
        """
        found: dict[str, Array] = {}
        block = estimate.block if estimate.valid_block < 0 else estimate.valid_block
        if (payload := estimate.payload) is not None:
            errors = in_stds(payload_error(self.payload(estimate.robot, block), payload), payload.covariance)
            found |= {name: errors[part] for name, part in PAYLOAD_PARTS.items()}
        for name, error in self.pose_errors(estimate, block).items():
            found[f"pose of {name}"] = in_stds(error, estimate.poses[name].covariance)
        return found

    def contradictions(self, estimate: Estimate) -> list[Contradiction]:
        """Return the quantities whose errors contradict the standard deviations of a valid estimate."""
        if estimate.status is not Validity.VALID:
            return []
        largest = {name: float(errors.max(initial=0.0)) for name, errors in self.in_stds(estimate).items()}
        return [Contradiction(name, stds) for name, stds in largest.items() if not stds <= MOST_STDS]

    def recovered(self, estimate: Estimate) -> bool:
        """Whether mass and centre of mass are so close to the truth that the robot has recovered from a load change."""
        truth = self.payload(estimate.robot, estimate.block)
        mass, com, _ = _compared(truth, estimate.payload)
        if mass.error_pct is None or com.error_mm is None:
            return False
        return mass.error_pct <= RECOVERED_MASS_PCT and com.error_mm <= RECOVERED_COM_MM


def why_stale(robots: Mapping[str, Estimate | RobotReport]) -> dict[str, list[str]]:
    """Return the reasons why estimates are stale, with the robots that give them."""
    names: dict[str, list[str]] = {}
    for name, robot in robots.items():
        for reason in robot.reasons if robot.status is Validity.STALE else ():
            names.setdefault(reason, []).append(name)
    return names


def _compared(truth: Inertia, estimate: PayloadEstimate | None) -> tuple[MassReport, ComReport, InertiaReport]:
    """Compare what is known of the mass, the centre of mass and the inertia with the truth."""
    mass, com, inertia = MassReport(truth.mass), ComReport(truth.com.tolist()), InertiaReport(truth.tensor.tolist())
    if estimate is None:
        return mass, com, inertia
    std = standard_deviations(estimate)
    error = 100.0 * abs(estimate.mass - truth.mass) / truth.mass
    mass = MassReport(mass.truth, estimate.mass, float(std[0]), error)
    if estimate.com is not None:
        distance = 1e3 * float(np.linalg.norm(estimate.com - truth.com))
        com = ComReport(com.truth, estimate.com.tolist(), std[1:4].tolist(), distance)
    if estimate.tensor is not None:
        error = 100.0 * float(np.linalg.norm(estimate.tensor - truth.tensor) / np.linalg.norm(truth.tensor))
        inertia = InertiaReport(
            inertia.truth, estimate.tensor.tolist(), unpack_symmetric(std[4:]).tolist(), error_pct=error
        )
    return mass, com, inertia


def standard_deviations(estimate: PayloadEstimate) -> Array:
    """Return the standard deviations of the known part of ``(m, h, J)``, shape (1,), (4,) or (10,)."""
    deviations: Array = np.sqrt(np.diagonal(estimate.covariance))
    return deviations

"""One robot's estimate against the truth."""

from __future__ import annotations

import bisect
from collections.abc import Iterable, Mapping, Sequence
from enum import StrEnum
from typing import Literal

import msgspec
import numpy as np

from coheft.app.results.errors import MOST_STDS, PAYLOAD_PARTS, in_stds, payload_error, pose_error
from coheft.app.results.states import State
from coheft.estimation.geometry.spatial import Array, Pose, rotation_log
from coheft.estimation.rigid_body.mass_properties import Inertia, unpack_symmetric
from coheft.wire.messages.scene import Scene
from coheft.wire.messages.structs import Estimate, PayloadEstimate, PoseEstimate, SensorErrorEstimate, Truth

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
    """Inertia at the centre of mass, axes of the robot's grasp frame [kg·m²].

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


class Contradiction(msgspec.Struct, frozen=True):
    """An error that the robot itself rules out: its estimate is valid, and claims to be nearer the truth than it is.

    Attributes:
        quantity: ``mass``, ``centre of mass``, ``inertia``, or ``pose of NAME``.
        stds: Largest error of any of its numbers, in that number's own standard deviations; more than 4.
    """

    quantity: str
    stds: float


class Verdict(StrEnum):
    """What the truth makes of an estimate, or of those of all robots; the worst first."""

    CONTRADICTED = "further off than it claims"
    NOT_CONVERGED = "not converged"
    CONVERGED = "converged"


class RobotReport(msgspec.Struct, frozen=True):
    """What one robot believes at one moment.

    Attributes:
        time_s: The moment [s].
        mass: Of the payload and all that lies on it.
        com: Its centre of mass.
        inertia: Its inertia.
        poses: Errors of the neighbours' grasp poses; none as long as it is still finding them.
        converged: The robot itself calls its estimate good enough.
        converged_at_s: When it first did [s]; None if never.
        not_observable: What it says that its motion could not tell.
        status: What it says of it: ``starting``, ``valid``, or ``stale`` if it cannot know whether that still holds.
        reasons: Why it is not valid, in its own words.
        state: How far it is, in the one word that all of coheft has for it.
        sensor_errors: What it has found out of its sensors.
        contradictions: Errors beyond four of its own standard deviations, while it calls its estimate valid.
    """

    time_s: float
    mass: MassReport
    com: ComReport
    inertia: InertiaReport
    poses: dict[str, PoseReport]
    converged: bool
    converged_at_s: float | None
    not_observable: list[str]
    status: Literal["starting", "valid", "stale"] = "starting"
    reasons: list[str] = []
    state: State = State.FINDING_NEIGHBOURS
    sensor_errors: list[SensorErrorEstimate] = []
    contradictions: list[Contradiction] = []

    def as_of_now(self, belief: Estimate) -> RobotReport:
        """The same in the light of what is known of the robot now: it may have fallen silent since."""
        is_valid = belief.status == "valid"
        return msgspec.structs.replace(
            self,
            status=belief.status,
            reasons=belief.reasons,
            state=State.of(belief),
            contradictions=self.contradictions if is_valid else [],
        )

    @property
    def verdict(self) -> Verdict:
        """Whether it knows all that it was asked for, by what it says of itself and by the truth."""
        if self.contradictions:
            return Verdict.CONTRADICTED
        return Verdict.CONVERGED if self.converged and self.status == "valid" else Verdict.NOT_CONVERGED


class Judge:
    """Knows the truth, and how it looks from every robot's grasp frame.

    Args:
        scene: Who holds the payload where.
        truths: In order of blocks.
    """

    def __init__(self, scene: Scene, truths: Iterable[Truth] = ()) -> None:
        self.scene = scene
        self._pose_payload_in = {
            name: Pose(rotation, translation).inverse()
            for name, rotation, translation in zip(scene.robots, scene.rotations, scene.translations, strict=True)
        }
        self._truths = list(truths)

    def add(self, truth: Truth, *, remember: int) -> None:
        """Learn the truth of one more block; only so many of the newest ones need be remembered."""
        self._truths.append(truth)
        if len(self._truths) >= 2 * remember:
            del self._truths[:-remember]

    def truth_at(self, block: int) -> Truth:
        """The truth of that block, or else of the last known one before it, or else the oldest one."""
        after = bisect.bisect_right(self._truths, block, key=lambda truth: truth.block)
        return self._truths[max(0, after - 1)]

    def pose_payload_in(self, robot: str, block: int) -> Pose:
        """Pose of the payload's frame in the robot's, in that block: its grasp may have slipped."""
        slipped = self.truth_at(block).slipped.get(robot) if self._truths else None
        if slipped is None:
            return self._pose_payload_in[robot]
        return Pose(slipped.rotation, slipped.translation).inverse()

    def payload(self, robot: str, block: int) -> Inertia:
        """The true payload of that block in the robot's frame."""
        truth = self.truth_at(block).payload
        return Inertia(truth.mass, truth.com, truth.tensor).carried(self.pose_payload_in(robot, block))

    def total_wrench(self, robot: str, block: int) -> Array | None:
        """The true total wrench (6,) at the last sample of that block about the robot's origin; None if not known."""
        truth = self.truth_at(block)
        if truth.block != block:
            return None
        wrench: Array = self.pose_payload_in(robot, block).adjoint() @ truth.total_wrench
        return wrench

    def relative_pose(self, robot: str, neighbour: str, block: int = -1) -> Pose:
        """The neighbour's true pose in the robot's frame, ``pose_j_in_i``, in that block."""
        return self.pose_payload_in(robot, block) @ self.pose_payload_in(neighbour, block).inverse()

    def pose_error(self, robot: str, neighbour: str, estimate: PoseEstimate, block: int) -> PoseReport:
        """Error of a neighbour's pose ``(R_ij, p_ij)``."""
        truth = self.relative_pose(robot, neighbour, block)
        turn = rotation_log(truth.rotation.T @ estimate.rotation)
        return PoseReport(
            rotation_error_deg=float(np.degrees(np.linalg.norm(turn))),
            translation_error_mm=1e3 * float(np.linalg.norm(estimate.translation - truth.translation)),
        )

    def robot(self, estimates: Sequence[Estimate]) -> RobotReport:
        """What a robot believes at the last of its estimates."""
        last = estimates[-1]
        truth = self.payload(last.robot, last.block)
        return RobotReport(
            time_s=last.time,
            mass=_mass(truth, last.payload),
            com=_com(truth, last.payload),
            inertia=_inertia(truth, last.payload),
            poses={name: self.pose_error(last.robot, name, pose, last.block) for name, pose in last.poses.items()}
            if last.phase == "inertia"
            else {},
            converged=last.converged,
            converged_at_s=next((estimate.time for estimate in estimates if estimate.is_converged), None),
            not_observable=list(last.not_observable),
            status=last.status,
            reasons=list(last.reasons),
            state=State.of(last),
            sensor_errors=list(last.sensor_errors),
            contradictions=self.contradictions(last),
        )

    def contradictions(self, estimate: Estimate) -> list[Contradiction]:
        """What a valid estimate claims to know better than it does."""
        if estimate.status != "valid":
            return []
        found: dict[str, Array] = {}
        if (payload := estimate.payload) is not None:
            errors = in_stds(payload_error(self.payload(estimate.robot, estimate.block), payload), payload.covariance)
            found |= {name: errors[part] for name, part in PAYLOAD_PARTS.items()}
        if estimate.phase == "inertia":
            for name, pose in estimate.poses.items():
                true = self.relative_pose(estimate.robot, name, estimate.block)
                error = pose_error(true, Pose(pose.rotation, pose.translation))
                found[f"pose of {name}"] = in_stds(error, pose.covariance)
        largest = {name: float(errors.max(initial=0.0)) for name, errors in found.items()}
        return [Contradiction(name, stds) for name, stds in largest.items() if not stds <= MOST_STDS]

    def recovered(self, estimate: Estimate) -> bool:
        """Mass and centre of mass are as near the truth as a robot needs to go on."""
        truth = self.payload(estimate.robot, estimate.block)
        mass, com = _mass(truth, estimate.payload).error_pct, _com(truth, estimate.payload).error_mm
        return mass is not None and mass <= RECOVERED_MASS_PCT and com is not None and com <= RECOVERED_COM_MM


def why_stale(robots: Mapping[str, Estimate | RobotReport]) -> dict[str, list[str]]:
    """Reasons for which estimates are stale, with the robots that give them."""
    names: dict[str, list[str]] = {}
    for name, robot in robots.items():
        for reason in robot.reasons if robot.status == "stale" else ():
            names.setdefault(reason, []).append(name)
    return names


def _mass(truth: Inertia, estimate: PayloadEstimate | None) -> MassReport:
    if estimate is None:
        return MassReport(truth.mass)
    return MassReport(
        truth=truth.mass,
        estimate=estimate.mass,
        std=float(standard_deviations(estimate)[0]),
        error_pct=100.0 * abs(estimate.mass - truth.mass) / truth.mass,
    )


def _com(truth: Inertia, estimate: PayloadEstimate | None) -> ComReport:
    if estimate is None or estimate.com is None:
        return ComReport(truth.com.tolist())
    return ComReport(
        truth=truth.com.tolist(),
        estimate=estimate.com.tolist(),
        std=standard_deviations(estimate)[1:4].tolist(),
        error_mm=1e3 * float(np.linalg.norm(estimate.com - truth.com)),
    )


def _inertia(truth: Inertia, estimate: PayloadEstimate | None) -> InertiaReport:
    if estimate is None or estimate.tensor is None:
        return InertiaReport(truth.tensor.tolist())
    return InertiaReport(
        truth=truth.tensor.tolist(),
        estimate=estimate.tensor.tolist(),
        std=unpack_symmetric(standard_deviations(estimate)[4:]).tolist(),
        error_pct=100.0 * float(np.linalg.norm(estimate.tensor - truth.tensor) / np.linalg.norm(truth.tensor)),
    )


def standard_deviations(estimate: PayloadEstimate) -> Array:
    """Standard deviations of what is there of ``(m, h, J)``, shape (1,), (4,) or (10,)."""
    deviations: Array = np.sqrt(np.diagonal(estimate.covariance))
    return deviations

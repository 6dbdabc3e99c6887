"""The report on an identification, which becomes JSON."""

from itertools import combinations

import msgspec
import numpy as np

from coheft.estimation.batch.holds import orientations
from coheft.estimation.batch.identification import CalibrationFinding, Identification
from coheft.estimation.batch.judge.verdict import Cause
from coheft.estimation.batch.pairs import LoopError
from coheft.estimation.batch.payload import Payload, principal_inertia
from coheft.estimation.batch.recording import Recording, Truth
from coheft.estimation.geometry.body_motion import perturbation_between
from coheft.estimation.geometry.spatial import rotation_log
from coheft.estimation.rigid_body.mass_properties import Inertia

_ALL_DIRECTIONS = 6
_LOOSE = 2.0
"""Largest error of loops of pairs, in standard deviations; noise makes one, or less where pairs share it."""


class Errors(msgspec.Struct, frozen=True):
    """Differences from the truth that the recording names; None where it is unknown, or nothing was found.

    Attributes:
        rotation_deg: Rotation error of relative poses, by pair of robots, if observable.
        position_mm: Position error of relative poses, by pair of robots, if observable.
        mass_kg: Mass, estimate minus truth.
        com_mm: Distance of the centres of mass.
        principal_pct: Principal moments, ascending, estimate minus truth [%].
    """

    rotation_deg: dict[str, float]
    position_mm: dict[str, float]
    mass_kg: float | None
    com_mm: float | None
    principal_pct: list[float] | None


class PoseReport(msgspec.Struct, frozen=True):
    """A robot's grasp frame in the first robot's, with standard deviations of the worst direction."""

    rotation: list[list[float]]
    rotation_vector_deg: list[float]
    position_m: list[float]
    rotation_std_deg: float
    position_std_mm: float


class PayloadReport(msgspec.Struct, frozen=True):
    """Mass properties in the first robot's grasp frame; None where the recording does not show them.

    Attributes:
        mass_kg: Mass.
        mass_std_kg: Standard deviation of the mass.
        com_m: Centre of mass.
        com_std_m: Standard deviations of the centre of mass.
        inertia: Inertia at the centre of mass [kg·m²].
        principal: Principal moments, ascending [kg·m²].
        principal_std: Their standard deviations.
        axes_deg: Rotation vector from the grasp frame to the principal axes.
        covariance: Covariance of ``(m, h, J packed as xx yy zz xy xz yz)``.
        was_possible: False if the best fit is physically impossible, and this is the most likely possible body.
        deviations_off: Distance of the best fit from this body, in its own standard deviations.
    """

    mass_kg: float | None
    mass_std_kg: float | None
    com_m: list[float] | None
    com_std_m: list[float] | None
    inertia: list[list[float]] | None
    principal: list[float] | None
    principal_std: list[float] | None
    axes_deg: list[float] | None
    covariance: list[list[float]]
    was_possible: bool
    deviations_off: float


class VerdictReport(msgspec.Struct, frozen=True):
    """Whether one rigid body explains the recording.

    Attributes:
        refuted: Whether it does not.
        cause: The fault, or "unknown" if no single one explains the recording; empty if there is none.
        robot: The robot that has the fault; None if it is no single one, or if it is not known which one.
        candidates: If it is not known which one, those that are nearly equally likely: robots, or "all robots".
        value: Parameters of the fault, see ``coheft.estimation.batch.judge.suspects``.
        ratio: Size of the residuals, in multiples of what noise explains.
        margin: Twice the log likelihood ratio to the second likeliest fault.
        second: The second likeliest fault.
        hidden_std: Additional standard deviations of ``(m, h, J packed as xx yy zz xy xz yz)`` by faults that the
            recording would not show; empty if refuted.
        hidden_cause: These faults, one for each number.
        proposal: Mass of the load with the fault estimated along, and its standard deviation [kg]; None if unknown.
    """

    refuted: bool
    cause: str
    robot: str | None
    candidates: list[str]
    value: list[float]
    ratio: float
    margin: float
    second: str
    hidden_std: list[float]
    hidden_cause: list[str]
    proposal: list[float] | None


class IdentifyReport(msgspec.Struct, frozen=True):
    """The report on a recording.

    Attributes:
        recording: File or folder of the recording.
        method: Name of the method, see ``coheft.app.identify.choices``.
        robots: Names of the robots; poses and mass properties are given in the grasp frame of the first.
        from_s: Time of the first sample that was used [s].
        to_s: Time of the last sample that was used [s].
        poses: Poses of the other robots' grasp frames; None if not observable.
        payload: Mass properties of the load.
        not_observable: What is not observable, and what would show it.
        doubts: Contradictions; if there are any, no number is to be trusted.
        verdict: The verdict on the recording; None if it was not judged.
        not_judged: Why it was not judged, so that nothing has checked the numbers; None if it was.
        remarks: Other remarks.
        loops: Errors of loops of three pairs of robots; empty if the method finds all poses at once.
        holds_s: Begin and end of each hold, ``[from, to]`` [s]; empty if holds were not used.
        hold_orientations: Number of different orientations of the load in these.
        calibration: Calibration errors of the robots; empty if they were not estimated.
        errors: Differences from the truth; None if the recording does not name it.
    """

    recording: str
    method: str
    robots: list[str]
    from_s: float
    to_s: float
    poses: dict[str, PoseReport | None]
    payload: PayloadReport
    not_observable: list[str]
    doubts: list[str]
    verdict: VerdictReport | None
    not_judged: str | None
    remarks: list[str]
    loops: list[LoopError]
    holds_s: list[list[float]]
    hold_orientations: int
    calibration: list[CalibrationFinding]
    errors: Errors | None


def _verdict(found: Identification) -> VerdictReport | None:
    verdict = found.verdict
    if verdict is None:
        return None
    return VerdictReport(
        refuted=verdict.is_refuted,
        cause=verdict.cause,
        robot=None if verdict.rivals else verdict.robot,
        candidates=list(verdict.candidates) if verdict.rivals else [],
        value=list(verdict.value),
        ratio=verdict.ratio,
        margin=verdict.margin,
        second=verdict.second,
        hidden_std=[error.std for error in found.hidden],
        hidden_cause=[error.cause for error in found.hidden],
        proposal=None if verdict.mass is None else list(verdict.mass),
    )


def make_report(source: str, recording: Recording, found: Identification) -> IdentifyReport:
    """Make the report on an identification of a recording from ``source``, a path or a name."""
    holds = found.holds
    return IdentifyReport(
        recording=source,
        method=found.method,
        robots=list(found.names),
        from_s=float(recording.time[0]),
        to_s=float(recording.time[-1]),
        poses={name: _pose(found, k) for k, name in enumerate(found.names) if k > 0},
        payload=_payload(found.payload),
        not_observable=_not_observable(found),
        doubts=list(found.doubts),
        verdict=_verdict(found),
        not_judged=found.not_judged or None,
        remarks=[*_loose_loops(recording, found), *found.remarks, *_changes(recording)],
        loops=list(found.loops),
        holds_s=[] if holds is None else [list(span) for span in holds.spans],
        hold_orientations=0 if holds is None else orientations(holds.down[:, 0]),
        calibration=list(found.calibration),
        errors=None if recording.truth is None else errors_of(recording, recording.truth, found),
    )


def _payload(payload: Payload) -> PayloadReport:
    moments, axes, moments_std = principal_inertia(payload.inertia.tensor, payload.covariance[4:, 4:])
    mass, com, inertia = payload.is_seen("mass"), payload.is_seen("com"), payload.is_seen("inertia")
    return PayloadReport(
        mass_kg=payload.inertia.mass if mass else None,
        mass_std_kg=float(payload.std[0]) if mass else None,
        com_m=payload.inertia.com.tolist() if com else None,
        com_std_m=payload.std[1:4].tolist() if com else None,
        inertia=payload.inertia.tensor.tolist() if inertia else None,
        principal=moments.tolist() if inertia else None,
        principal_std=moments_std.tolist() if inertia else None,
        axes_deg=np.degrees(rotation_log(axes)).tolist() if inertia else None,
        covariance=payload.covariance.tolist(),
        was_possible=payload.was_possible,
        deviations_off=payload.deviations_off,
    )


def _not_observable(found: Identification) -> list[str]:
    sentences = []
    cause = "" if found.verdict is None else found.verdict.cause
    mended = {Cause.CLOCK.value: "first set clocks right", Cause.UNKNOWN.value: "first mend what is doubted below"}
    remedy_of_poses = mended.get(cause, "turn the load about other axes as well")
    for k, name in enumerate(found.names[1:], 1):
        directions = found.team.relative(0, k).unobservable
        if len(directions) == _ALL_DIRECTIONS:
            sentences.append(f"pose of {name}: the load has to move and turn")
        elif directions:
            parts = ", ".join(str(direction) for direction in directions)
            sentences.append(f"pose of {name}, {parts}: {remedy_of_poses}")
    if found.is_explained:  # the fault may be the reason for the rest
        return sentences
    are_poses_seen = not sentences
    for part in found.payload.unobservable:
        # With all poses known, gravity would show the mass.
        is_mass = part.quantity == "mass"
        remedy = part.remedy if are_poses_seen or not is_mass else "first, all poses have to be seen"
        sentences.append(f"{part.what}: {remedy}")
    return sentences


def _loose_loops(recording: Recording, found: Identification) -> tuple[str, ...]:
    """Say if pairs agree less well than their standard deviations predict."""
    worst = max((loop.deviations for loop in found.loops), default=0.0)
    if worst < _LOOSE or found.calibration:
        return ()
    remedy = "Try --method pose --calibrate" if recording.has("pose") else "Record poses, and try --calibrate"
    return (
        f"Pairs fail to close by {worst:.1f} of their standard deviations, so true errors are larger than these say: "
        f"robots are not well calibrated, or their clocks differ. {remedy}.",
    )


def _changes(recording: Recording) -> tuple[str, ...]:
    """Say if the load changed meanwhile, according to the truth."""
    start, end = recording.time[[0, -1]]
    loads = () if recording.truth is None else recording.truth.loads
    times = ", ".join(f"{since:g} s" for since, _ in loads if start < since < end)
    if not times:
        return ()
    return (
        f"The load changed at {times}, by the truth that this recording names: choose a part with --from and --to.",
    )


def _pose(found: Identification, robot: int) -> PoseReport | None:
    relative = found.team.relative(0, robot)
    if relative.unobservable:
        return None
    return PoseReport(
        rotation=relative.pose.rotation.tolist(),
        rotation_vector_deg=np.degrees(rotation_log(relative.pose.rotation)).tolist(),
        position_m=relative.pose.translation.tolist(),
        rotation_std_deg=float(np.degrees(relative.rotation_std)),
        position_std_mm=1e3 * relative.translation_std,
    )


def errors_of(recording: Recording, truth: Truth, found: Identification) -> Errors:
    """Errors of an identification."""
    rotation, position = {}, {}
    for i, j in combinations(range(len(found.names)), 2):
        if found.team.relative(i, j).unobservable:
            continue
        pair = f"{found.names[i]}-{found.names[j]}"
        rotation[pair], position[pair] = pose_errors(truth, found, i, j)
    load = truth.load_between(float(recording.time[0]), float(recording.time[-1]))
    if load is None:
        return Errors(rotation, position, None, None, None)
    mass, com, principal = load_errors(found.payload.inertia, load)
    is_seen = found.payload.is_seen
    return Errors(
        rotation_deg=rotation,
        position_mm=position,
        mass_kg=mass if is_seen("mass") else None,
        com_mm=com if is_seen("com") else None,
        principal_pct=principal if is_seen("inertia") else None,
    )


def pose_errors(truth: Truth, found: Identification, i: int, j: int) -> tuple[float, float]:
    """Errors of robot j's pose in robot i's grasp frame: rotation [degrees], position [mm]."""
    estimate, true = (poses[i].inverse() @ poses[j] for poses in (found.team.poses, truth.poses))
    error = perturbation_between(true, estimate)
    return float(np.degrees(np.linalg.norm(error[:3]))), float(1e3 * np.linalg.norm(error[3:]))


def load_errors(estimate: Inertia, truth: Inertia) -> tuple[float, float, list[float]]:
    """Errors of mass [kg], centre of mass [mm] and principal moments [%]."""
    moments, true_moments = (np.linalg.eigvalsh(inertia.tensor) for inertia in (estimate, truth))
    return (
        estimate.mass - truth.mass,
        float(1e3 * np.linalg.norm(estimate.com - truth.com)),
        (100.0 * (moments / true_moments - 1.0)).tolist(),
    )

"""From a recording of poses to the load, with or without doubts about the robots' calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from coheft.errors import RecordingError
from coheft.estimation.batch.calibrated_fit import CalibratedFit, fit_calibrated
from coheft.estimation.batch.calibration import (
    POSITION_SCALE,
    ZERO,
    Tolerances,
    corrected_poses,
    gimbal_angles,
)
from coheft.estimation.batch.calibration_bounds import cut_to_bounds
from coheft.estimation.batch.calibration_findings import calibration_findings
from coheft.estimation.batch.doubts import unsettled
from coheft.estimation.batch.hand_eye import HandEye, fit_hand_eye
from coheft.estimation.batch.hand_eye_equations import ERRORS, GRASP, position_scale_rows, unknowns_of
from coheft.estimation.batch.identification import Identification
from coheft.estimation.batch.identify import (
    at_first_grasp,
    centre_of,
    covariance_by_poses,
    grasps_from_twists,
    parameters_fit,
)
from coheft.estimation.batch.judge.cause import Cause
from coheft.estimation.batch.judge.mend import mend
from coheft.estimation.batch.judge.verdict import Verdict
from coheft.estimation.batch.judged import check_assumption, judge, with_hidden
from coheft.estimation.batch.payload import make_payload, of_central_numbers
from coheft.estimation.batch.plausibility import plausible_signals
from coheft.estimation.batch.pose_conventions import inverse_poses
from coheft.estimation.batch.pose_differences import derivative_by_poses, turned_covariance
from coheft.estimation.batch.recording import Recording
from coheft.estimation.batch.signals import CUTOFF, EDGE, Signals, signals_of
from coheft.estimation.batch.statistics import SPAN
from coheft.estimation.batch.team_poses import TeamPoses
from coheft.estimation.batch.wrist_poses import WristPoses
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.derivatives import seen_inertia_derivative
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.estimation.rigid_body.regressor import INERTIA_SIZE

_POSES_PER_SECOND = 25.0
_MENDINGS = 2
"""A clock that poses show is finished by forces: it may be that of the poses alone, or of all that is recorded."""
_LARGEST_TURN, _LARGEST_SHIFT = 1.0, 0.01
"""Poses that fit worse than this, averaged over a 25th of a second, are not of one load [degrees, m]."""
_IDENTIFIABLE = (
    "Seen from poses: zeros of each gimbal's first two angles, all angle scales, ratios of position scales. Seen from "
    "forces: ratios of force scales, offsets across gravity, and the common position scale by comparing accelerations "
    "with gravity.",
    "Not seen by any motion: zero of the gimbal's last angle (it turns the grasp frame itself), what all forces have "
    "too much in common (it looks like mass), offsets that lift or weigh. For these the stated uncertainty is that of "
    "the tolerances.",
)
_BEYOND = (
    "No calibration errors within the bounds explain this recording, so they were taken for Gaussian: are the robots "
    "worse than the bounds say?"
)


def identify_poses(
    recording: Recording, tolerances: Tolerances | None = None, cutoff: float = CUTOFF, assume: str | None = None
) -> Identification:
    """Grasps from poses, nothing differentiated; the load from motion, every robot with all others as instruments.

    Args:
        recording: With poses and wrenches.
        tolerances: How well the robots are calibrated; what may be wrong is estimated along. None: perfectly.
        cutoff: Of the filter for the load's motion [Hz].
        assume: What is wrong with the recording, as verdicts name it: that is taken out of it, and what is left is
            identified. Not with tolerances.

    Raises:
        RecordingError: Something is missing, calibration errors cannot be told from so short a motion, or what is
            assumed does not explain the recording.
    """
    if assume is None:
        return _identify(recording, tolerances, cutoff, None)
    mended = recording
    words: list[str] = []
    found = _identify(recording, None, cutoff, assume)
    verdict = check_assumption(found.verdict, assume)
    for _ in range(_MENDINGS):
        centre = centre_of(found.team.poses)
        mended = mend(mended, verdict, [centre.inverse() @ pose for pose in found.team.poses])
        words.append(f"Taken out, as assumed ({assume}): {verdict.words}")
        found = _identify(mended, None, cutoff, assume)
        if found.verdict is None or not found.verdict.is_refuted or found.verdict.cause != assume:
            break
        verdict = found.verdict
    return replace(found, remarks=(*words, *found.remarks))


def _identify(
    recording: Recording, tolerances: Tolerances | None, cutoff: float, assumed: str | None
) -> Identification:
    """Identify, arguments as of ``identify_poses``."""
    signals = plausible_signals(recording, cutoff)
    if tolerances is not None:
        _check_duration(recording, signals)
    recording.stacked("wrench")  # better refused before the long fit than after it
    wrists = WristPoses.of(recording.stacked("pose"), recording.rate, at_home=tolerances is not None)
    start, loops = grasps_from_twists(signals, with_instruments=True)
    grasps = fit_hand_eye(wrists.averaged(_POSES_PER_SECOND), start.team.poses, tolerances)
    if tolerances is None:
        found = _without_doubts(recording, signals, grasps)
    else:
        found = _with_doubts(recording, grasps, tolerances, cutoff)
    suspicions = (*_suspicions(grasps), *unsettled(grasps.team, grasps.is_settled))
    verdict = None
    if tolerances is None and not any(map(recording.has, ("twist", "dtwist", "acceleration"))):
        verdict = judge(recording, signals, grasps, cutoff, is_suspicious=bool(suspicions), assumed=assumed)
        if verdict is not None and verdict.cause == Cause.UNKNOWN:
            verdict = _inverse(recording, cutoff) or verdict
        if verdict is not None and not verdict.is_refuted:
            found = with_hidden(found, verdict)
        elif verdict is not None and verdict.cause != Cause.UNKNOWN:
            suspicions = ()  # this is what they are about
    return replace(found, loops=tuple(loops), suspicions=suspicions, verdict=verdict)


def _inverse(recording: Recording, cutoff: float) -> Verdict | None:
    """That all poses are inverse, if they are: then they fit each other, but not the forces."""
    robots = {
        name: replace(robot, pose=None if robot.pose is None else inverse_poses(robot.pose))
        for name, robot in recording.robots.items()
    }
    try:
        signals = plausible_signals(inverse := replace(recording, robots=robots), cutoff)
        wrists = WristPoses.of(inverse.stacked("pose"), recording.rate, at_home=False)
        start, _ = grasps_from_twists(signals, with_instruments=True)
    except RecordingError:
        return None
    grasps = fit_hand_eye(wrists.averaged(_POSES_PER_SECOND), start.team.poses)
    verdict = None if _suspicions(grasps) else judge(inverse, signals, grasps, cutoff)
    if verdict is None or verdict.is_refuted:
        return None
    return Verdict(
        is_refuted=True,
        cause=Cause.INVERSE,
        words="forces are not those of a load that moves like this, but they are if all poses are those of the home "
        "frame in the grasp frame, and not the other way round: invert them",
    )


def _check_duration(recording: Recording, signals: Signals) -> None:
    """Refuse motions over which residuals are hardly independent: nothing would say how certain the errors are."""
    if len(signals.time) < SPAN * signals.rate:
        raise RecordingError(
            f"found samples from {recording.span}, of which {EDGE:g} s are dropped at both ends: too little is left to "
            f"estimate calibration errors along. Record at least {2.0 * EDGE + SPAN:g} s, choose a longer part with "
            f"--from and --to, or leave --calibrate out"
        )


def _suspicions(grasps: HandEye) -> tuple[str, ...]:
    """That poses do not fit together, in words."""
    turn, shift = float(np.degrees(grasps.noise[0])), grasps.noise[1]
    if turn < _LARGEST_TURN and shift < _LARGEST_SHIFT:
        return ()
    return (
        f"Poses differ by {turn:.2g}° and {1e3 * shift:.2g} mm from those of robots that hold one load. Are all clocks "
        f"alike, quaternions in the order qx qy qz qw, poses those of grasp frames in home frames that stand still? "
        f"Did no one let go, and are the robots calibrated (--calibrate)?",
    )


def _without_doubts(recording: Recording, signals: Signals, grasps: HandEye) -> Identification:
    poses = grasps.team.poses
    fit = parameters_fit(signals, poses)
    covariance = fit.covariance + covariance_by_poses(signals, grasps.team)
    return Identification(
        method="pose",
        names=recording.names,
        team=grasps.team,
        payload=make_payload(of_central_numbers(fit.numbers), covariance, poses),
        remarks=(
            "Standard deviations hold only if the robots are perfectly calibrated; --calibrate estimates what is wrong "
            "with them.",
        ),
        time=signals.time,
        residual=fit.residual,
    )


def _with_doubts(recording: Recording, grasps: HandEye, tolerances: Tolerances, cutoff: float) -> Identification:
    signals = signals_of(corrected(recording, grasps.errors), cutoff)
    poses = grasps.team.poses

    def fit_with(moved: Sequence[Pose], start: CalibratedFit | None = None) -> CalibratedFit:
        from_centre = [centre_of(moved).inverse() @ pose for pose in moved]
        return fit_calibrated(signals, from_centre, tolerances, recording.gravity, start)

    gaussian = fit_with(poses)

    def numbers_with(moved: Sequence[Pose]) -> Array:
        return _at_first_grasp(fit_with(moved, gaussian), moved)[0]

    by_poses = derivative_by_poses(numbers_with, poses)
    cut = cut_to_bounds(gaussian, tolerances, grasps.errors[:, POSITION_SCALE].ravel())
    fit = cut or gaussian
    numbers, covariance = _at_first_grasp(fit, poses)
    team = _in_true_lengths(grasps, fit)
    covariance = covariance + by_poses @ _given_errors(grasps) @ by_poses.T + turned_covariance(numbers_with, team)
    # A wrong zero of the first robot's gimbal turns the frame that everything is given in.
    inertia = of_central_numbers(numbers)
    turned = seen_inertia_derivative(Pose.identity(), inertia)[:, :3] * grasps.errors_std[0, ZERO]
    return Identification(
        method="pose",
        names=recording.names,
        team=team,
        payload=make_payload(inertia, covariance + turned @ turned.T, team.poses),
        calibration=calibration_findings(recording.names, grasps, fit, tolerances),
        remarks=(*_IDENTIFIABLE, *(() if cut else (_BEYOND,))),
        time=signals.time,
        residual=fit.residual,
    )


def corrected(recording: Recording, errors: Array) -> Recording:
    """What robots would have recorded without these errors of their poses, shape (N, 7); forces turn along.

    Raises:
        ValueError: A robot did not record poses and wrenches.
    """
    robots = {}
    for (name, robot), own in zip(recording.robots.items(), errors, strict=True):
        if robot.pose is None or robot.wrench is None:
            raise ValueError(f"expected poses and wrenches of {name}")
        told = Rotation.from_quat(robot.pose[:, 3:]).as_matrix()
        rotations, positions = corrected_poses(gimbal_angles(told), robot.pose[:, :3], own)
        turn = rotations.swapaxes(-1, -2) @ told
        wrench = (robot.wrench.reshape(-1, 2, 3) @ turn.swapaxes(-1, -2)).reshape(-1, 6)
        pose = np.hstack([positions, Rotation.from_matrix(rotations).as_quat()])
        robots[name] = replace(robot, pose=pose, wrench=wrench, twist=None, dtwist=None, acceleration=None)
    return replace(recording, robots=robots)


def _at_first_grasp(fit: CalibratedFit, poses: Sequence[Pose]) -> tuple[Array, Array]:
    """``(m, h, J)`` (10,) in the first robot's frame, in true lengths, and covariance, of a fit about the centre."""
    centre = centre_of(poses)
    true_centre = Pose(centre.rotation, fit.scale * centre.translation)
    numbers, by_parameters = at_first_grasp(Inertia.from_barycentric(fit.parameters), true_centre)
    # The centre, too, lies as far away as the scale says.
    by_scale = np.concatenate([[0.0], centre.translation, np.zeros(6)])
    derivative = np.column_stack([by_parameters, by_scale])
    known = fit.covariance[: INERTIA_SIZE + 1, : INERTIA_SIZE + 1]
    return numbers, derivative @ known @ derivative.T


def _given_errors(grasps: HandEye) -> Array:
    """Covariance of all grasps' perturbations if the errors were known, shape (6 N, 6 N)."""
    count = len(grasps.errors)
    known = np.eye(len(grasps.covariance))[unknowns_of(count, ERRORS)]
    return _conditional(grasps.covariance, unknowns_of(count, GRASP), known)


def _conditional(covariance: Array, kept: npt.NDArray[np.intp], known: Array) -> Array:
    """Covariance of some unknowns if some combinations of all, rows of ``known``, were known."""
    cross = covariance[kept] @ known.T
    result: Array = covariance[np.ix_(kept, kept)] - cross @ np.linalg.pinv(known @ covariance @ known.T) @ cross.T
    return result


def _in_true_lengths(grasps: HandEye, fit: CalibratedFit) -> TeamPoses:
    """Poses in true lengths: the forces' motion decides about the scale that poses leave open."""
    count = len(grasps.errors)
    common = position_scale_rows(count).mean(axis=0, keepdims=True)
    covariance = _conditional(grasps.covariance, unknowns_of(count, GRASP), common)
    lengths = np.tile([1.0, 1.0, 1.0, fit.scale, fit.scale, fit.scale], count)
    stretched = np.concatenate([np.concatenate([np.zeros(3), pose.translation]) for pose in grasps.team.poses])
    scale_variance = fit.covariance[INERTIA_SIZE, INERTIA_SIZE]
    return TeamPoses(
        poses=tuple(Pose(pose.rotation, fit.scale * pose.translation) for pose in grasps.team.poses),
        covariance=covariance * np.outer(lengths, lengths) + scale_variance * np.outer(stretched, stretched),
        limits=grasps.team.limits,
    )

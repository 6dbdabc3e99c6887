"""Identification from recorded poses, with or without estimating the robots' calibration errors."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.errors import RecordingError
from coheft.estimation.batch.calibrated_fit import CalibratedFit, cut_to_bounds, fit_calibrated
from coheft.estimation.batch.hand_eye import HandEye, fit_hand_eye
from coheft.estimation.batch.hand_eye_equations import ERRORS, GRASP, position_scale_rows, unknowns_of
from coheft.estimation.batch.identification import CalibrationFinding, Identification, unsettled
from coheft.estimation.batch.identify import identify_at_grasps
from coheft.estimation.batch.judge.evidence import POSES_PER_SECOND, Evidence, suspicions_about
from coheft.estimation.batch.pairs import TeamPoses, derivative_by_poses, grasps_from_twists, unseen_covariance
from coheft.estimation.batch.payload import make_payload, of_central_numbers
from coheft.estimation.batch.plausibility import plausible_signals
from coheft.estimation.batch.recording import Recording, RobotRecord
from coheft.estimation.batch.signals import CUTOFF, EDGE, centre_of, signals_of
from coheft.estimation.batch.statistics import SPAN
from coheft.estimation.batch.wrist_poses import (
    LARGEST_TILT,
    POSITION_SCALE,
    UNIFORM_BOUND,
    ZERO,
    Tolerances,
    WristPoses,
    corrected_poses,
)
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.derivatives import central_derivative, seen_inertia_derivative
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.estimation.rigid_body.regressor import INERTIA_SIZE

_IDENTIFIABLE = (
    "Observable from poses: zeros of each gimbal's first two angles, all angle scales, ratios of position scales. "
    "Observable from forces: ratios of force scales, offsets across gravity, and the common position scale, by "
    "comparing accelerations with gravity.",
    "Not observable by any motion: zero of the gimbal's last angle (it rotates the grasp frame itself), the common "
    "scale of all forces (it looks like mass), offsets along gravity. For these the stated uncertainty is that of the "
    "tolerances.",
)
_DEG = float(np.degrees(1.0))
_KINDS = (
    *((f"zero of angle {angle}", "deg", _DEG) for angle in "abc"),
    *((f"scale of angle {angle}", "%", 100.0) for angle in "abc"),
    ("position scale", "%", 100.0),
    ("force scale", "%", 100.0),
    *((f"force offset {axis}", "N", 1.0) for axis in "xyz"),
)
"""Names, units, and factors to these units."""
_SEEN = 0.5
"""Share of its former standard deviation below which an error counts as seen."""


def identify_poses(
    recording: Recording, tolerances: Tolerances | None = None, cutoff: float = CUTOFF
) -> Identification:
    """Identify grasps from poses, without derivatives, and the load from motion, with other robots as instruments.

    Without ``tolerances`` of calibration errors robots are taken to be perfectly calibrated.
    """
    signals = plausible_signals(recording, cutoff)
    if tolerances is not None and len(signals.time) < SPAN * signals.rate:  # too short for independent residuals
        raise RecordingError(
            f"found samples from {recording.span}, of which {EDGE:g} s are dropped at both ends: too little is left to "
            f"estimate calibration errors along. Record at least {2.0 * EDGE + SPAN:g} s, choose a longer part with "
            f"--from and --to, or leave --calibrate out"
        )
    wrists = WristPoses.of(recording.stacked("pose"), recording.rate, at_home=tolerances is not None)
    start, loops = grasps_from_twists(signals, with_instruments=True)
    grasps = fit_hand_eye(wrists.averaged(POSES_PER_SECOND), start.poses, tolerances)
    if tolerances is None:
        found = replace(
            identify_at_grasps("pose", recording, signals, grasps.team),
            remarks=(
                "Standard deviations hold only if the robots are perfectly calibrated; --calibrate estimates their "
                "calibration errors.",
            ),
            evidence=Evidence.of_poses(recording, signals, cutoff, grasps),
        )
    else:
        found = _with_calibration(recording, wrists, grasps, tolerances, cutoff)
    suspicions = (*suspicions_about(grasps), *unsettled(grasps.team))
    return replace(found, loops=tuple(loops), suspicions=(*suspicions, *found.suspicions))


def _with_calibration(
    recording: Recording, wrists: WristPoses, grasps: HandEye, tolerances: Tolerances, cutoff: float
) -> Identification:
    right = _corrected(recording, wrists, grasps.errors)
    signals = signals_of(right, cutoff)
    poses = grasps.team.poses

    def fit_with(moved: Sequence[Pose], start: CalibratedFit | None = None) -> CalibratedFit:
        from_centre = [centre_of(moved).inverse() @ pose for pose in moved]
        return fit_calibrated(signals, from_centre, tolerances, recording.gravity, start)

    gaussian = fit_with(poses)

    def numbers_with(moved: Sequence[Pose]) -> Array:
        return _at_first_grasp(fit_with(moved, gaussian), moved)[0]

    by_poses = derivative_by_poses(numbers_with, poses)
    errors = np.eye(len(grasps.covariance))[unknowns_of(len(poses), ERRORS)]
    cut = cut_to_bounds(gaussian, tolerances, grasps.errors[:, POSITION_SCALE].ravel())
    fit = cut or gaussian
    numbers, covariance = _at_first_grasp(fit, poses)
    team = _in_true_lengths(grasps, fit)
    covariance = covariance + by_poses @ _given(grasps, errors) @ by_poses.T + unseen_covariance(numbers_with, team)
    # A wrong zero of the first robot's gimbal rotates the reference frame.
    inertia = of_central_numbers(numbers)
    calibration = _findings(recording.names, wrists.has_gimbal, grasps, fit, tolerances)
    turned = seen_inertia_derivative(Pose.identity(), inertia)[:, :3] * grasps.errors_std[0, ZERO]
    return Identification(
        method="pose",
        names=recording.names,
        team=team,
        payload=make_payload(inertia, covariance + turned @ turned.T, team.seen),
        calibration=calibration,
        remarks=(*_without_gimbals(recording.names, wrists), *_IDENTIFIABLE),
        suspicions=() if cut else (_beyond_bounds(calibration),),
        time=signals.time,
        residual=fit.residual,
        evidence=_after_calibration(right, grasps, fit, team, tolerances, cutoff),
    )


def _findings(
    names: Sequence[str], has_gimbal: Iterable[np.bool_], grasps: HandEye, fit: CalibratedFit, tolerances: Tolerances
) -> tuple[CalibrationFinding, ...]:
    """All calibration errors, robot by robot; those of angles only of robots that have a gimbal."""
    count = len(names)
    std = np.sqrt(np.diag(fit.covariance))[INERTIA_SIZE:]
    rows = position_scale_rows(count)
    contrasts = rows - rows.mean(axis=0)
    ratio_std = np.sqrt(np.einsum("ku,uv,kv->k", contrasts, grasps.covariance, contrasts))
    errors, errors_std = grasps.errors.copy(), grasps.errors_std.copy()
    errors[:, POSITION_SCALE] = (1.0 + errors[:, POSITION_SCALE]) / fit.scale - 1.0
    errors_std[:, POSITION_SCALE] = np.hypot(ratio_std, std[0])[:, None]
    # In the order of _KINDS.
    values = np.column_stack([errors, fit.force_scale, fit.force_offset])
    stds = np.column_stack([errors_std, std[1 : 1 + count], std[1 + count :].reshape(count, 3)])
    before = np.append(tolerances.pose_errors(), [tolerances.force_scale, *[tolerances.force_offset] * 3])
    return tuple(
        CalibrationFinding(
            robot=name,
            what=what,
            unit=unit,
            value=size * float(value),
            std=size * float(own),
            std_before=size * float(former),
            seen=bool(own < _SEEN * former),
        )
        for name, is_gimbal, own_values, own_stds in zip(names, has_gimbal, values, stds, strict=True)
        for (what, unit, size), value, own, former in zip(_KINDS, own_values, own_stds, before, strict=True)
        if is_gimbal or "of angle" not in what
    )


def _beyond_bounds(findings: Sequence[CalibrationFinding]) -> str:
    """Say that no errors within their bounds explain a recording, and which one is farthest beyond.

    Zeros, whose distribution has no bounds, are left out.
    """
    bounded = [finding for finding in findings if not finding.what.startswith("zero")]
    worst = max(bounded, key=lambda finding: (abs(finding.value) - UNIFORM_BOUND * finding.std_before) / finding.std)
    return (
        f"No calibration errors within the bounds explain this recording: the {worst.what} of {worst.robot} would be "
        f"{worst.value:.3g} {worst.unit} (std {worst.std:.2g}), the bound is {UNIFORM_BOUND * worst.std_before:.3g} "
        f"{worst.unit}, and nothing says how far the others are beyond theirs. Check that robot; or, if all may be as "
        f"far off, say so by wider bounds, as --force-scale or --position-scale"
    )


def _without_gimbals(names: Sequence[str], wrists: WristPoses) -> tuple[str, ...]:
    """Say whose angles were taken to be exact."""
    others = [name for name, has_gimbal in zip(names, wrists.has_gimbal, strict=True) if not has_gimbal]
    if not others:
        return ()
    return (
        f"No gimbal that is zero at home has the orientations of {', '.join(others)}: its second angle would exceed "
        f"{LARGEST_TILT:g}°. Standard deviations hold only if these orientations are exact; no zeros and scales of "
        f"angles were estimated. If there is a gimbal, give poses relative to a home in the middle of the motion.",
    )


def _after_calibration(
    right: Recording, grasps: HandEye, fit: CalibratedFit, team: TeamPoses, tolerances: Tolerances, cutoff: float
) -> Evidence:
    """Evidence for the judge from a recording whose poses are corrected: that of forces corrected, in true lengths."""
    robots = {}
    poses, wrenches = right.stacked("pose"), right.stacked("wrench")
    for name, pose, wrench, scale, offset in zip(
        right.names, poses, wrenches, fit.force_scale, fit.force_offset, strict=True
    ):
        own = np.hstack([Rotation.from_quat(pose[:, 3:]).inv().apply(offset), np.zeros((len(pose), 3))])
        lengths = np.repeat([fit.scale, 1.0], [3, 4])
        robots[name] = RobotRecord(right.time, pose=pose * lengths, wrench=(wrench - own) / (1.0 + scale))
    right = replace(right, robots=robots)
    tilt = float(np.sqrt(np.mean(grasps.errors_std[:, ZERO] ** 2)))
    evidence = Evidence.of_poses(right, signals_of(right, cutoff), cutoff, replace(grasps, team=team))
    return replace(evidence, tolerances=tolerances, tilt=tilt)


def _corrected(recording: Recording, wrists: WristPoses, errors: Array) -> Recording:
    """Correct a recording with these wrists for errors of its poses, shape (N, 7); wrenches are rotated accordingly."""
    robots, wrenches = {}, recording.stacked("wrench")
    for robot, (name, wrench, own) in enumerate(zip(recording.names, wrenches, errors, strict=True)):
        turned, positions = corrected_poses(wrists.angles[robot], wrists.positions[robot], own)
        rotations = wrists.zeros[robot] @ turned
        turn = rotations.swapaxes(-1, -2) @ wrists.rotations(robot)
        robots[name] = RobotRecord(
            recording.time,
            pose=np.hstack([positions, Rotation.from_matrix(rotations).as_quat()]),
            wrench=(wrench.reshape(-1, 2, 3) @ turn.swapaxes(-1, -2)).reshape(-1, 6),
        )
    return replace(recording, robots=robots)


def _at_first_grasp(fit: CalibratedFit, poses: Sequence[Pose]) -> tuple[Array, Array]:
    """``(m, h, J)`` (10,) in the first robot's frame and true lengths, and their covariance (10, 10)."""
    centre = centre_of(poses)
    true_centre = Pose(centre.rotation, fit.scale * centre.translation)
    about_centre = Inertia.from_barycentric(fit.parameters)
    # The position of the centre depends on the scale, too.
    by_scale = np.concatenate([[0.0], centre.translation, np.zeros(6)])
    derivative = np.column_stack([central_derivative(about_centre), by_scale])
    known = fit.covariance[: INERTIA_SIZE + 1, : INERTIA_SIZE + 1]
    return about_centre.transported(true_centre).central(), derivative @ known @ derivative.T


def _given(grasps: HandEye, known: Array) -> Array:
    """Covariance (6 N, 6 N) of the grasps, given linear combinations of all unknowns, the rows of ``known``."""
    covariance, kept = grasps.covariance, unknowns_of(len(grasps.errors), GRASP)
    cross = covariance[kept] @ known.T
    return covariance[np.ix_(kept, kept)] - cross @ np.linalg.pinv(known @ covariance @ known.T) @ cross.T


def _in_true_lengths(grasps: HandEye, fit: CalibratedFit) -> TeamPoses:
    """Grasp poses in true lengths: poses alone do not determine the common scale, but forces do."""
    count = len(grasps.errors)
    covariance = _given(grasps, position_scale_rows(count).mean(axis=0, keepdims=True))
    lengths = np.tile([1.0, 1.0, 1.0, fit.scale, fit.scale, fit.scale], count)
    stretched = np.concatenate([np.concatenate([np.zeros(3), pose.translation]) for pose in grasps.team.poses])
    scale_variance = fit.covariance[INERTIA_SIZE, INERTIA_SIZE]
    return TeamPoses(
        poses=tuple(Pose(pose.rotation, fit.scale * pose.translation) for pose in grasps.team.poses),
        covariance=covariance * np.outer(lengths, lengths) + scale_variance * np.outer(stretched, stretched),
        is_settled=grasps.team.is_settled,
    )

"""From a recording of poses to the load, with or without doubts about the robots' calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.estimation.batch.calibrated_fit import CalibratedFit, fit_calibrated
from coheft.estimation.batch.calibration import (
    POSITION_SCALE,
    ZERO,
    Tolerances,
    corrected_poses,
    gimbal_angles,
)
from coheft.estimation.batch.calibration_bounds import cut_to_bounds
from coheft.estimation.batch.hand_eye import UNKNOWNS, HandEye, WristPoses, fit_hand_eye
from coheft.estimation.batch.identify import (
    CUTOFF,
    CalibrationFinding,
    Identification,
    centre_of,
    grasps_from_twists,
    parameters_fit,
)
from coheft.estimation.batch.payload import central_numbers, derivative_by_poses, make_payload, of_central_numbers
from coheft.estimation.batch.recording import Recording, check_recording
from coheft.estimation.batch.signals import signals_of
from coheft.estimation.inertia import INERTIA_SIZE
from coheft.estimation.inertia_derivatives import barycentric_derivative, seen_inertia_derivative
from coheft.estimation.rigid_body import Inertia
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.team_registration import TeamPoses

_POSES_PER_SECOND = 25.0
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
    recording: Recording, tolerances: Tolerances | None = None, cutoff: float = CUTOFF
) -> Identification:
    """Grasps from poses, nothing differentiated; the load from motion, every robot with all others as instruments.

    Args:
        recording: With poses and wrenches.
        tolerances: How well the robots are calibrated; what may be wrong is estimated along. None: perfectly.
        cutoff: Of the filter for the load's motion [Hz].

    Raises:
        RecordingError: Something is missing.
    """
    check_recording(recording)
    wrists = WristPoses.of(recording.stacked("pose"), recording.rate, at_home=tolerances is not None)
    recording.stacked("wrench")
    start, loops = grasps_from_twists(signals_of(recording, cutoff), with_instruments=True)
    grasps = fit_hand_eye(wrists.averaged(_POSES_PER_SECOND), start.poses, tolerances)
    if tolerances is None:
        found = _without_doubts(recording, grasps, cutoff)
    else:
        found = _with_doubts(recording, grasps, tolerances, cutoff)
    return replace(found, loops=tuple(loops))


def _without_doubts(recording: Recording, grasps: HandEye, cutoff: float) -> Identification:
    signals, poses = signals_of(recording, cutoff), grasps.team.poses
    fit = parameters_fit(signals, poses)
    by_poses = derivative_by_poses(lambda moved: parameters_fit(signals, moved).numbers, poses)
    covariance = fit.covariance + by_poses @ grasps.team.covariance @ by_poses.T
    return Identification(
        method="pose",
        names=recording.names,
        team=grasps.team,
        payload=make_payload(of_central_numbers(fit.numbers), covariance, poses),
        remarks=("The robots were taken to be perfectly calibrated; --calibrate estimates what is wrong with them.",),
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
    by_poses = derivative_by_poses(lambda moved: _at_first_grasp(fit_with(moved, gaussian), moved)[0], poses)
    cut = cut_to_bounds(gaussian, tolerances, grasps.errors[:, POSITION_SCALE].ravel())
    fit = cut or gaussian
    numbers, covariance = _at_first_grasp(fit, poses)
    covariance = covariance + by_poses @ _given_errors(grasps) @ by_poses.T
    # A wrong zero of the first robot's gimbal turns the frame that everything is given in.
    inertia = of_central_numbers(numbers)
    turned = seen_inertia_derivative(Pose.identity(), inertia)[:, :3] * grasps.errors_std[0, ZERO]
    team = _in_true_lengths(grasps, fit)
    return Identification(
        method="pose",
        names=recording.names,
        team=team,
        payload=make_payload(inertia, covariance + turned @ turned.T, team.poses),
        calibration=_findings(recording.names, grasps, fit, tolerances),
        remarks=(*_IDENTIFIABLE, *(() if cut else (_BEYOND,))),
        time=signals.time,
        residual=fit.residual,
    )


def corrected(recording: Recording, errors: Array) -> Recording:
    """What robots would have recorded without these errors of their poses, shape (N, 7); forces turn along."""
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
    about_centre = Inertia.from_barycentric(fit.parameters)
    # By theta and the scale: the centre, too, lies as far away as the scale says.
    derivative = np.zeros((INERTIA_SIZE, INERTIA_SIZE + 1))
    derivative[:, :INERTIA_SIZE] = np.linalg.inv(barycentric_derivative(about_centre))
    derivative[1:4, INERTIA_SIZE] = centre.translation
    known = fit.covariance[: INERTIA_SIZE + 1, : INERTIA_SIZE + 1]
    numbers = central_numbers(about_centre.carried(Pose(centre.rotation, fit.scale * centre.translation)))
    return numbers, derivative @ known @ derivative.T


def _unknowns(count: int, part: slice) -> Array:
    """Indices of some of every robot's unknowns."""
    own = np.arange(UNKNOWNS)[part]
    return np.concatenate([k * UNKNOWNS + own for k in range(count)])


def _given_errors(grasps: HandEye) -> Array:
    """Covariance of all grasps' perturbations if the errors were known, shape (6 N, 6 N)."""
    count = len(grasps.homes)
    return _conditional(
        grasps.covariance,
        _unknowns(count, slice(6, 12)),
        np.eye(len(grasps.covariance))[_unknowns(count, slice(12, None))],
    )


def _conditional(covariance: Array, kept: Array, known: Array) -> Array:
    """Covariance of some unknowns if some combinations of all, rows of ``known``, were known."""
    cross = covariance[kept] @ known.T
    result: Array = covariance[np.ix_(kept, kept)] - cross @ np.linalg.pinv(known @ covariance @ known.T) @ cross.T
    return result


def _in_true_lengths(grasps: HandEye, fit: CalibratedFit) -> TeamPoses:
    """Poses in true lengths: the forces' motion decides about the scale that poses leave open."""
    count = len(grasps.homes)
    common = np.zeros((1, count * UNKNOWNS))
    common[0, _unknowns(count, slice(12 + POSITION_SCALE.start, 12 + POSITION_SCALE.stop))] = 1.0 / count
    covariance = _conditional(grasps.covariance, _unknowns(count, slice(6, 12)), common)
    lengths = np.tile([1.0, 1.0, 1.0, fit.scale, fit.scale, fit.scale], count)
    stretched = np.concatenate([np.concatenate([np.zeros(3), pose.translation]) for pose in grasps.team.poses])
    scale_variance = fit.covariance[INERTIA_SIZE, INERTIA_SIZE]
    return TeamPoses(
        poses=tuple(Pose(pose.rotation, fit.scale * pose.translation) for pose in grasps.team.poses),
        covariance=covariance * np.outer(lengths, lengths) + scale_variance * np.outer(stretched, stretched),
        limits=grasps.team.limits,
    )


def _findings(
    names: Sequence[str], grasps: HandEye, fit: CalibratedFit, tolerances: Tolerances
) -> tuple[CalibrationFinding, ...]:
    """All that may be wrong, robot by robot."""
    count = len(names)
    spread = np.sqrt(np.diag(fit.covariance))[INERTIA_SIZE + 1 :]
    common = 1.0 / fit.scale
    labels = [
        "zero of angle a",
        "zero of angle b",
        "zero of angle c",
        "scale of angle a",
        "scale of angle b",
        "scale of angle c",
        "position scale",
    ]
    units = ["deg"] * 3 + ["%"] * 4
    sizes = np.repeat([np.degrees(1.0), 100.0], [3, 4])
    before = tolerances.pose_errors()
    found = []
    for k, name in enumerate(names):
        values, stds = grasps.errors[k].copy(), grasps.errors_std[k].copy()
        values[POSITION_SCALE] = (1.0 + values[POSITION_SCALE]) * common - 1.0
        stds[POSITION_SCALE] = np.hypot(_ratio_std(grasps, k), np.sqrt(fit.covariance[INERTIA_SIZE, INERTIA_SIZE]))
        found += [
            CalibrationFinding(name, *row)
            for row in zip(labels, units, sizes * values, sizes * stds, sizes * before, strict=True)
        ]
        found.append(
            CalibrationFinding(
                name, "force scale", "%", 100 * fit.force_scale[k], 100 * spread[k], 100 * tolerances.force_scale
            )
        )
        for axis in range(3):
            std = spread[count + 3 * k + axis]
            value = float(fit.force_offset[k, axis])
            found.append(
                CalibrationFinding(name, f"force offset {'xyz'[axis]}", "N", value, std, tolerances.force_offset)
            )
    return tuple(found)


def _ratio_std(grasps: HandEye, robot: int) -> float:
    """Standard deviation of a robot's position scale beside the mean of all."""
    count = len(grasps.homes)
    contrast = np.zeros(count * UNKNOWNS)
    contrast[_unknowns(count, slice(12 + POSITION_SCALE.start, 12 + POSITION_SCALE.stop))] = -1.0 / count
    contrast[robot * UNKNOWNS + 12 + POSITION_SCALE.start] += 1.0
    return float(np.sqrt(contrast @ grasps.covariance @ contrast))

"""A load that is held still: intervals in a recording, or holds that were recorded separately from its motion.

Mass and centre of mass follow from holds (Zhang et al., sec. III-C).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d
from scipy.spatial.transform import Rotation

from coheft.errors import RecordingError
from coheft.estimation.batch.recording import Recording, RobotRecord
from coheft.estimation.batch.signals import PAPER_CUTOFF, smooth_poses, total_wrench
from coheft.estimation.chi_square import chi_square_threshold
from coheft.estimation.geometry.spatial import Array, Pose, skew

_TOLERANCE = 0.5
"""Largest difference of forces from the middle of their range [N]."""
_DURATION = 6.0
"""Least duration of a hold [s]."""
_SMOOTHING = 1.0
"""Time over which forces are averaged before they are compared [s]: their noise is not motion."""
_CHANCE = 0.01
"""Probability that residuals are taken for larger than the samples' noise explains by chance."""
_SAME = np.radians(2.0)
"""Orientations that differ by less than this count as one [rad]; a load that rotates by more is not held still."""


@dataclass(frozen=True, eq=False)
class Holds:
    """Mean measurements of N robots, each in its own grasp frame, in H holds.

    Attributes:
        spans: Begin and end of each hold [s].
        down: Gravity, shape (H, N, 3) [m/s²].
        wrench: ``(f, t)`` on the load, shape (H, N, 6).
        scatter: Variances of the mean wrenches' components, if noise is white, shape (H, N, 6).
    """

    spans: tuple[tuple[float, float], ...]
    down: Array
    wrench: Array
    scatter: Array


def held_spans(recording: Recording) -> list[tuple[int, int]]:
    """First and one past the last sample of each hold: those that the recording names, or else those that are found."""
    if recording.holds is None:
        return find_holds(recording.stacked("wrench")[..., :3], recording.time)
    borders = np.searchsorted(recording.time, np.array(recording.holds).reshape(-1, 2))
    return [(int(start), int(end)) for start, end in borders if end > start]


def find_holds(forces: Array, time: Array) -> list[tuple[int, int]]:
    """First and one past the last sample of each interval in which no robot's force (N, n, 3) [N] changes."""
    rate = (len(time) - 1) / (time[-1] - time[0])
    length, smoothing = round(_DURATION * rate), max(1, round(_SMOOTHING * rate))
    if len(time) < length:
        return []
    smooth = uniform_filter1d(forces, smoothing, axis=1)
    ranges = maximum_filter1d(smooth, length, axis=1) - minimum_filter1d(smooth, length, axis=1)
    # These are ranges of windows about each sample; keep the windows that lie within the recording.
    begun = ranges[:, length // 2 : length // 2 + len(time) - length + 1]
    steady = (begun < 2.0 * _TOLERANCE).all(axis=(0, 2))
    found: list[tuple[int, int]] = []
    for start in np.flatnonzero(steady):
        if found and start < found[-1][1]:
            found[-1] = (found[-1][0], int(start) + length)
        else:
            found.append((int(start), int(start) + length))
    return found


def holds_of(recording: Recording, cutoff: float = PAPER_CUTOFF) -> Holds:
    """Measurements in the holds of a checked recording; ``cutoff`` is that of the filter for orientations [Hz]."""
    wrench, time, spans = recording.stacked("wrench"), recording.time, held_spans(recording)
    if recording.has("pose"):
        rotations, _ = smooth_poses(recording.stacked("pose"), recording.rate, cutoff)
        down = recording.gravity @ rotations
    else:  # at rest, accelerometers measure minus gravity
        down = -recording.stacked("acceleration")
    count = len(recording.robots)
    return Holds(
        spans=tuple((float(time[start]), float(time[end - 1])) for start, end in spans),
        down=np.array([down[:, start:end].mean(axis=1) for start, end in spans]).reshape(-1, count, 3),
        wrench=np.array([wrench[:, start:end].mean(axis=1) for start, end in spans]).reshape(-1, count, 6),
        scatter=np.array([wrench[:, s:e].var(axis=1) / (e - s) for s, e in spans]).reshape(-1, count, 6),
    )


def orientations(directions: Array) -> int:
    """How many different ones there are among directions of gravity (H, 3)."""
    different: list[Array] = []
    for direction in directions / np.linalg.norm(directions, axis=1, keepdims=True):
        if all(np.linalg.norm(direction - other) > _SAME for other in different):
            different.append(direction)
    return len(different)


def static_estimate(holds: Holds, poses: Sequence[Pose]) -> tuple[Array, Array]:
    """Mass and centre of mass from forces at rest: ``sum f = -m g`` and ``sum (p x f + t) = -m h x g`` (eqs 9, 10).

    Returns:
        ``(m, h)`` in the first robot's frame, shape (4,) [kg, m], and their covariance (4, 4).

    Raises:
        RecordingError: There are too few orientations.
    """
    down = holds.down[:, 0]
    found = orientations(down)
    if found < 2:
        spans = ", ".join(f"{start:.1f} to {end:.1f} s" for start, end in holds.spans)
        held = f"{len(down)} holds: {spans}" if spans else f"{len(down)} holds"
        raise RecordingError(
            f"the centre of mass needs the load to be held still in at least 2 orientations, {np.degrees(_SAME):g} "
            f"degrees or more apart; found {found} in {held}. Hold it in others as well, {_DURATION:g} s each; or "
            f"use --method instruments without --holds, which takes mass and centre of mass from the motion"
        )
    total = total_wrench(holds.wrench.swapaxes(0, 1), poses)
    adjoints = np.array([pose.adjoint() for pose in poses])
    spread = np.einsum("iab,hib,icb->hac", adjoints, holds.scatter, adjoints)
    direction = down / np.linalg.norm(down, axis=1, keepdims=True)
    strength = float(np.linalg.norm(down, axis=1).mean())
    weights = -np.einsum("ha,ha->h", direction, total[:, :3])
    mass = float(weights.mean() / strength)
    matrix = mass * skew(down).reshape(-1, 3)  # -m h x g = m [g]x h
    torque = total[:, 3:].ravel()
    com = np.linalg.lstsq(matrix, torque)[0].astype(np.float64)
    # Noise of the samples, and what residuals show beyond it: holds are few.
    gain = np.zeros((len(down), 4, 6))
    gain[:, 0, :3] = -direction / (len(down) * strength)
    gain[:, 1:, 3:] = np.linalg.pinv(matrix).reshape(3, -1, 3).swapaxes(0, 1)
    gain[:, 1:] -= com[:, None] / mass * gain[:, :1]  # the same forces are in the mass
    covariance: Array = np.sum(gain @ spread @ gain.swapaxes(1, 2), axis=0)
    forces = np.einsum("ha,hab,hb->h", direction, spread[:, :3, :3], direction)
    torques = np.trace(spread[:, 3:, 3:], axis1=1, axis2=2) / 3.0
    excess = _excess(weights - weights.mean(), len(weights) - 1, float(forces.mean()))
    covariance[0, 0] += excess / len(weights) / strength**2
    excess = _excess(torque - matrix @ com, len(torque) - 3, float(torques.mean()))
    covariance[1:, 1:] += excess * np.linalg.inv(matrix.T @ matrix)
    return np.concatenate([[mass], com]), covariance


def _excess(residuals: Array, degrees: int, variance: float) -> float:
    """By how much residuals show a larger variance than the samples, if that is not chance."""
    squares = float(np.sum(residuals**2))
    if squares <= variance * chi_square_threshold(degrees, _CHANCE):
        return 0.0
    return squares / degrees - variance


def means_in_holds(recording: Recording, spans: Sequence[tuple[int, int]] | None = None) -> Recording:
    """Mean poses and wrenches in holds, one sample for each, whose times are the numbers of the holds.

    ``spans`` are the first and one past the last sample of each hold; None: ``held_spans``.
    """
    if spans is None and not (spans := held_spans(recording)):
        raise RecordingError(
            f"the load is never held still from {recording.span}: expected forces that change by less than 0.5 N "
            f"for 6 s, or 'holds' that say when"
        )
    robots = {}
    for name, pose, wrench in zip(recording.names, recording.stacked("pose"), recording.stacked("wrench"), strict=True):
        means = []
        for number, (start, end) in enumerate(spans, 1):
            rotations = Rotation.from_quat(pose[start:end, 3:])
            mean = rotations.mean()
            turn = float((mean.inv() * rotations).magnitude().max())
            if turn > _SAME:
                raise RecordingError(
                    f"hold {number}, samples {start + 1} to {end}: the load turns by {np.degrees(turn):.2g}°, "
                    f"expected one that is held still, within {np.degrees(_SAME):g}°"
                )
            means.append(np.concatenate([pose[start:end, :3].mean(axis=0), mean.as_quat()]))
        wrenches = np.array([wrench[start:end].mean(axis=0) for start, end in spans])
        robots[name] = RobotRecord(np.arange(len(spans), dtype=np.float64), pose=np.array(means), wrench=wrenches)
    return Recording(robots, gravity=recording.gravity)


def holds_of_means(means: Recording) -> Holds:
    """The same measurements with gravity in the grasp frames; nothing is known of the samples' noise."""
    pose, wrench = means.stacked("pose"), means.stacked("wrench").swapaxes(0, 1)
    down = Rotation.from_quat(pose[..., 3:].reshape(-1, 4)).inv().apply(means.gravity).reshape(*pose.shape[:2], 3)
    return Holds(spans=(), down=down.swapaxes(0, 1), wrench=wrench, scatter=np.zeros_like(wrench))

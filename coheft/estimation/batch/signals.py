"""Smooth motions from recorded samples, by low-pass filters and differences, and those of the load's body frame.

All signals go through the same filter, forwards and backwards, which causes no delay. The first and the last seconds
are dropped (Zhang et al., sec. IV-B).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation

from coheft.errors import RecordingError
from coheft.estimation.batch.recording import Recording
from coheft.estimation.geometry.body_motion import grasp_measurements
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.regressor import features, regressor_coefficients

ORDER = 3
PAPER_CUTOFF = 5.0
"""Cutoff for plain least squares, whose bias grows with it [Hz]."""
CUTOFF = 3.0
"""Cutoff for unbiased methods: above, there is hardly any motion [Hz]."""
EDGE = 2.0
"""Time that is dropped at both ends [s]."""
OVERSAMPLING = 6.0
"""Samples that are kept per period of the cutoff frequency."""
_FEWEST = 50


_COEFFICIENTS = regressor_coefficients(with_offset=False)[:, :, :-1]


@dataclass(frozen=True, eq=False)
class Signals:
    """Smooth simultaneous signals of N robots, each in its own grasp frame.

    Attributes:
        time: Shape (n,) [s].
        motion: ``(w, v, a, alpha)``, shape (N, n, 12), see ``body_motion``.
        up: ``a`` minus the acceleration of the origin according to twists: minus gravity, shape (N, n, 3) [m/s²].
        wrench: ``(f, t)`` on the payload, shape (N, n, 6).
        rotation: Of ``F_i`` in the home frame, shape (N, n, 3, 3); None without poses.
    """

    time: Array
    motion: Array
    up: Array
    wrench: Array
    rotation: Array | None

    @property
    def rate(self) -> float:
        """Samples per second."""
        return float((len(self.time) - 1) / (self.time[-1] - self.time[0]))

    @property
    def twists(self) -> Array:
        """``(w, v)``, shape (N, n, 6)."""
        return self.motion[..., :6]


def low_pass(samples: Array, rate: float, cutoff: float = PAPER_CUTOFF, axis: int = 0) -> Array:
    """Butterworth filter of third order, forwards and backwards."""
    if cutoff >= 0.5 * rate:
        raise RecordingError(
            f"{rate:g} samples per second cannot be filtered at {cutoff:g} Hz: record more, or choose a --cutoff below "
            f"{0.5 * rate:g}"
        )
    shortest = int(np.ceil(3.0 * rate / cutoff))
    if samples.shape[axis] <= shortest:
        raise RecordingError(
            f"found {samples.shape[axis]} samples, but the filter takes more than {shortest}: record for longer, or "
            f"choose a longer part with --from and --to"
        )
    sections = butter(ORDER, cutoff, fs=rate, output="sos")
    return sosfiltfilt(sections, samples, axis=axis, padlen=shortest)


def derivative(difference: Callable[[int], Array], rate: float) -> Array:
    """Central difference of fourth order (Richardson), (N, n - 4, ...): two samples are lost at both ends.

    The one of second order reduces an oscillation of angular frequency ``w`` by ``(w / rate)^2 / 6``, accelerations
    twice as much, so that inertias would be too large: by 0.2 % for motions of 2 Hz at 100 samples per second.

    ``difference(k)`` returns differences between the samples ``k`` later and ``k`` earlier, (N, n - 2 k, ...).
    """
    return rate * (2.0 * difference(1)[:, 1:-1] / 3.0 - difference(2) / 12.0)


def rates(samples: Array, rate: float) -> Array:
    """Derivative along the second axis, (N, n, ...) to (N, n - 4, ...)."""
    return derivative(lambda k: samples[:, 2 * k :] - samples[:, : -2 * k], rate)


def smooth_poses(poses: Array, rate: float, cutoff: float = PAPER_CUTOFF) -> tuple[Array, Array]:
    """Filtered rotations (N, n, 3, 3) and positions (N, n, 3) of poses ``x y z qx qy qz qw``, shape (N, n, 7)."""
    smooth = low_pass(without_jumps(poses), rate, cutoff, axis=1)
    rotations = Rotation.from_quat(smooth[..., 3:].reshape(-1, 4)).as_matrix()
    return rotations.reshape(*poses.shape[:2], 3, 3), smooth[..., :3]


def without_jumps(poses: Array) -> Array:
    """The same poses ``x y z qx qy qz qw``, shape (..., n, 7), with signs such that no quaternion jumps."""
    changes = np.sum(poses[..., 1:, 3:] * poses[..., :-1, 3:], axis=-1)
    continuous = poses.copy()
    continuous[..., 1:, 3:] *= np.cumprod(np.where(changes < 0.0, -1.0, 1.0), axis=-1)[..., None]
    return continuous


def turns(before: Array, after: Array) -> Array:
    """Angles between poses (n, 7) of one frame, shape (n,) [rad]; their quaternions may be rounded."""
    one, other = (Rotation.from_quat(poses[:, 3:]) for poses in (before, after))
    return np.asarray((one.inv() * other).magnitude())


def body_rates(rotations: Array, rate: float) -> Array:
    """Angular velocity (N, n - 4, 3) in axes with rotations (N, n, 3, 3), by ``log(R_before^T R_after)``."""

    def turn(k: int) -> Array:
        turns = rotations[:, : -2 * k].swapaxes(-1, -2) @ rotations[:, 2 * k :]
        result: Array = Rotation.from_matrix(turns.reshape(-1, 3, 3)).as_rotvec()
        return result.reshape(*turns.shape[:2], 3)

    return derivative(turn, rate)


def signals_of(recording: Recording, cutoff: float = PAPER_CUTOFF) -> Signals:
    """Smooth signals of a checked recording.

    Channels that were not recorded are derived: twists from poses, their derivatives from twists, proper accelerations
    from these and gravity in the home frame.
    """
    rate, count = recording.rate, len(recording.time)

    def smooth(channel: str, lost: int) -> Array:
        return low_pass(recording.stacked(channel), rate, cutoff, axis=1)[:, lost : count - lost]

    lost, rotation = 0, None  # samples at both ends, by differences
    if recording.has("pose"):
        rotation, position = smooth_poses(recording.stacked("pose"), rate, cutoff)
    if recording.has("twist"):
        twist = smooth("twist", 0)
    elif rotation is not None:
        velocity = (rates(position, rate)[..., None, :] @ rotation[:, 2:-2])[..., 0, :]  # in the grasp frame
        twist, lost = np.concatenate([body_rates(rotation, rate), velocity], axis=-1), 2
    else:
        raise RecordingError(
            f"found neither {_lacks(recording, 'pose')} nor {_lacks(recording, 'twist')}: one is needed"
        )
    if recording.has("dtwist"):
        dtwist = smooth("dtwist", lost)
    else:
        dtwist, twist, lost = rates(twist, rate), twist[:, 2:-2], lost + 2
    time, rotation = recording.time[lost : count - lost], None if rotation is None else rotation[:, lost : count - lost]
    moved = dtwist[..., 3:] + np.cross(twist[..., :3], twist[..., 3:])
    if recording.has("acceleration"):
        a = smooth("acceleration", lost)
    elif rotation is not None:
        a = moved - recording.gravity @ rotation
    else:
        raise RecordingError(
            f"found neither {_lacks(recording, 'pose')} nor {_lacks(recording, 'acceleration')}: nothing tells where "
            f"down is"
        )
    wrench = smooth("wrench", lost)
    inner_time = (time >= recording.time[0] + EDGE) & (time <= recording.time[-1] - EDGE)
    # There is nothing above the cutoff: fewer samples suffice.
    every = max(1, int(rate / (OVERSAMPLING * cutoff)))
    kept = np.flatnonzero(inner_time)[::every]
    if len(kept) < _FEWEST:
        needed = 2.0 * EDGE + _FEWEST * every / rate
        raise RecordingError(
            f"found samples from {recording.span}, of which {EDGE:g} s are dropped at both ends: too few are left. "
            f"Record at least {np.ceil(needed):g} s, or choose a longer part with --from and --to"
        )
    return Signals(
        time=time[kept],
        motion=np.concatenate([twist, a, dtwist[..., :3]], axis=-1)[:, kept],
        up=(a - moved)[:, kept],
        wrench=wrench[:, kept],
        rotation=None if rotation is None else rotation[:, kept],
    )


def _lacks(recording: Recording, channel: str) -> str:
    return f"'{channel}' of all robots (not of {', '.join(recording.without(channel))})"


def body_motions(signals: Signals, poses: Sequence[Pose]) -> Array:
    """Motion ``(w, v, a, alpha)`` of the body frame, predicted by each robot's own signals, shape (N, n, 12).

    ``poses`` are those of the grasp frames in the body frame.
    """
    motions = []
    for pose, motion in zip(poses, signals.motion, strict=True):
        motions.append(np.hstack([grasp_measurements(pose.inverse(), motion), motion[:, 9:] @ pose.rotation.T]))
    return np.array(motions)


def total_wrench(wrenches: Array, poses: Sequence[Pose]) -> Array:
    """Sum ``(F, T)`` about the origin of the body frame, shape (n, 6), of all robots' wrenches (N, n, 6)."""
    result: Array = np.sum([own @ pose.adjoint().T for own, pose in zip(wrenches, poses, strict=True)], axis=0)
    return result


def regressor(motion: Array) -> Array:
    """``Y`` (n, 6, 10) with ``(F, T) = Y theta``, ``theta = (m, m h, I_o)``, of body motions (n, 12)."""
    return np.tensordot(features(motion, np.zeros((len(motion), 6))), _COEFFICIENTS, axes=1)


def centre_of(poses: Sequence[Pose]) -> Pose:
    """Frame at the middle of the grasps, with the first one's axes: no robot's noise has a long lever there."""
    return Pose(np.eye(3), np.mean([pose.translation for pose in poses], axis=0))

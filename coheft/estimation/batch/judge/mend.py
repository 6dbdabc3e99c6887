"""Corrects a recording for the fault that the verdict names."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.errors import RecordingError
from coheft.estimation.batch.judge.verdict import Cause, Verdict
from coheft.estimation.batch.plausibility import inverse_poses, turned_poses
from coheft.estimation.batch.recording import CHANNELS, Recording
from coheft.estimation.batch.signals import without_jumps
from coheft.estimation.geometry.spatial import Array, Pose

MENDABLE = (
    *(Cause.OFFSET, Cause.DRIFT, Cause.LEVER, Cause.SCALE, Cause.FORCE_SCALE, Cause.MOMENT_SCALE, Cause.AXIS_SCALE),
    *(Cause.BASE_AXES, Cause.HOME_MOMENTS, Cause.TURNED, Cause.EXCHANGED, Cause.SWAPPED, Cause.CLOCK),
    *(Cause.LENGTH_SCALE, Cause.GRAVITY, Cause.NOT_LEVEL, Cause.INVERSE),
)
"""Faults whose parameters determine what sensors would have measured without them."""
_LONG = 0.5
"""Delays beyond which the end that is made up by a correction is left out [s]; seconds at both ends are dropped."""


def mend(recording: Recording, verdict: Verdict, poses: Sequence[Pose]) -> Recording:
    """Correct a recording for the fault of a verdict; ``poses`` of the grasp frames are in the verdict's body frame.

    Raises:
        RecordingError: The fault cannot be corrected.
    """
    value, name = np.array(verdict.value), verdict.robot
    match verdict.cause:
        case Cause.OFFSET | Cause.DRIFT:
            # Only the total matters: an offset may be subtracted from any robot's wrench.
            index = recording.names.index(name) if name else 0
            minutes = recording.time[:, None] / 60.0
            offset = value[:6] + (minutes * value[6:] if len(value) > 6 else np.zeros((len(minutes), 6)))
            own = offset @ np.linalg.inv(poses[index].adjoint()).T
            return recording.changed("wrench", lambda wrench: wrench - own, recording.names[index])
        case Cause.LEVER:
            about = Pose(np.eye(3), -value).adjoint()
            return recording.changed("wrench", lambda wrench: wrench @ about.T, name)
        case Cause.SCALE | Cause.FORCE_SCALE | Cause.MOMENT_SCALE:
            factors = np.ones(6)
            factors[: 6 if verdict.cause == Cause.SCALE else 3] = 1.0 / value[0]
            if verdict.cause == Cause.MOMENT_SCALE:
                factors = factors[::-1]
            return recording.changed("wrench", lambda wrench: wrench * factors, name)
        case Cause.AXIS_SCALE:
            factors = np.where(np.arange(6) == value[1], 1.0 / value[0], 1.0)
            return recording.changed("wrench", lambda wrench: wrench * factors, name)
        case Cause.BASE_AXES:
            for own_name, pose in zip(recording.names, recording.stacked("pose"), strict=True):
                if name in (None, own_name):
                    turns = Rotation.from_quat(pose[:, 3:]).inv().as_matrix()
                    recording = recording.changed("wrench", partial(_rotated, rotations=turns, halves=value), own_name)
            return recording
        case Cause.HOME_MOMENTS:
            for own_name in recording.names if name is None else [name]:
                recording = about_grasp(recording, own_name, is_turned=bool(value[0]))
            return recording
        case Cause.TURNED:
            return recording.changed("wrench", partial(_rotated, rotations=value.reshape(1, 3, 3)), name)
        case Cause.EXCHANGED:
            return recording.changed("wrench", lambda wrench: wrench[:, [3, 4, 5, 0, 1, 2]], name)
        case Cause.SWAPPED:
            one, other = (int(index) for index in value)
            wrenches = recording.stacked("wrench")
            recording = recording.changed("wrench", lambda _: wrenches[other], recording.names[one])
            return recording.changed("wrench", lambda _: wrenches[one], recording.names[other])
        case Cause.CLOCK:
            for channel in verdict.channels:
                recording = recording.changed(channel, partial(_earlier, time=recording.time, delay=value[0]), name)
            lost = (max(0.0, -value[0]), max(0.0, value[0])) if abs(value[0]) > _LONG else (0.0, 0.0)
            return recording.between(recording.time[0] + lost[0], recording.time[-1] - lost[1])
        case Cause.LENGTH_SCALE:
            lengths = np.repeat([1.0 / value[0], 1.0], [3, 4])
            return recording.changed("pose", lambda pose: pose * lengths, name)
        case Cause.GRAVITY | Cause.NOT_LEVEL:
            assert verdict.gravity is not None
            for own_name, down in zip(recording.names, verdict.gravity, strict=True):
                turn, _ = Rotation.align_vectors(recording.gravity[None], down[None])
                recording = recording.changed("pose", partial(turned_poses, turn=turn), own_name)
            return recording
        case Cause.INVERSE:
            return recording.changed("pose", inverse_poses)
        case cause:
            raise RecordingError(f"nothing says what sensors would have read without '{cause}': {verdict.words}")


def about_grasp(recording: Recording, name: str, *, is_turned: bool) -> Recording:
    """Give moments of a robot, which are about the origin of its home frame, about that of its grasp frame.

    If the wrench ``is_turned``, it is also in the axes of the home frame.
    """
    pose = recording.stacked("pose")[recording.names.index(name)]
    to_grasp = Rotation.from_quat(pose[:, 3:]).inv()
    place = to_grasp.apply(pose[:, :3])

    def about(wrench: Array) -> Array:
        force, moment = wrench[:, :3], wrench[:, 3:]
        if is_turned:
            force, moment = to_grasp.apply(force), to_grasp.apply(moment)
        return np.hstack([force, moment - np.cross(place, force)])

    return recording.changed("wrench", about, name)


def _rotated(wrench: Array, rotations: Array, halves: Sequence[float] | Array = (1.0, 1.0)) -> Array:
    """Rotate forces and moments (n, 6), where ``halves`` is 1, by rotations (n, 3, 3) or one (1, 3, 3)."""
    turned = (wrench.reshape(-1, 2, 3) @ rotations.swapaxes(-1, -2)).reshape(-1, 6)
    return np.where(np.repeat(halves, 3) == 1.0, turned, wrench)


def _earlier(samples: Array, time: Array, delay: float) -> Array:
    """Shift samples (n, width) to an earlier time by ``delay`` [s]; at the ends, repeat the last one."""
    is_pose = samples.shape[1] == len(CHANNELS["pose"])
    if is_pose:
        samples = without_jumps(samples)
    moved = np.stack([np.interp(time + delay, time, column) for column in samples.T], axis=-1)
    if is_pose:
        moved[:, 3:] /= np.linalg.norm(moved[:, 3:], axis=1, keepdims=True)
    return moved

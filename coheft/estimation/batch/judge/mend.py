"""Corrects a recording for the fault that the verdict names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.errors import RecordingError
from coheft.estimation.batch.judge.verdict import Cause, Verdict
from coheft.estimation.batch.pose_conventions import inverse_poses
from coheft.estimation.batch.recording import Recording, RobotRecord
from coheft.estimation.geometry.spatial import Array, Pose

MENDABLE = (
    Cause.OFFSET,
    Cause.DRIFT,
    Cause.LEVER,
    Cause.SCALE,
    Cause.FORCE_SCALE,
    Cause.MOMENT_SCALE,
    Cause.BASE_AXES,
    Cause.TURNED,
    Cause.CLOCK,
    Cause.LENGTH_SCALE,
    Cause.GRAVITY,
    Cause.NOT_LEVEL,
    Cause.INVERSE,
)
"""Faults whose parameters determine what sensors would have measured without them."""


def mend(recording: Recording, verdict: Verdict, poses: Sequence[Pose]) -> Recording:
    """Correct a recording for the fault of a verdict.

    Args:
        recording: The recording, with wrenches.
        verdict: The verdict; its cause is one of ``MENDABLE``.
        poses: Poses of the grasp frames in the body frame, in which the verdict's numbers are.

    Raises:
        RecordingError: The fault cannot be corrected.
    """
    value = np.array(verdict.value)
    match verdict.cause:
        case Cause.OFFSET | Cause.DRIFT:
            # Only the total matters: an offset may be subtracted from any robot's wrench.
            index = recording.names.index(verdict.robot) if verdict.robot else 0
            minutes = recording.time[:, None] / 60.0
            wrench = value[:6] + (minutes * value[6:] if len(value) > 6 else np.zeros((len(minutes), 6)))
            own = wrench @ np.linalg.inv(poses[index].adjoint()).T
            return _changed(
                recording, recording.names[index], lambda robot: replace(robot, wrench=wrench_of(robot) - own)
            )
        case Cause.LEVER:
            return _changed(recording, verdict.robot, lambda robot: _with_moment_about(robot, value))
        case Cause.SCALE | Cause.FORCE_SCALE | Cause.MOMENT_SCALE:
            factors = np.ones(6)
            factors[: 6 if verdict.cause == Cause.SCALE else 3] = 1.0 / value[0]
            if verdict.cause == Cause.MOMENT_SCALE:
                factors = factors[::-1]
            return _changed(recording, verdict.robot, lambda robot: _scaled(robot, factors))
        case Cause.BASE_AXES:
            return _changed(recording, verdict.robot, lambda robot: _turned(robot, _rotations(robot).swapaxes(-1, -2)))
        case Cause.TURNED:
            return _changed(recording, verdict.robot, lambda robot: _turned(robot, value.reshape(1, 3, 3)))
        case Cause.CLOCK:
            return _changed(recording, verdict.robot, lambda robot: _earlier(robot, float(value[0]), verdict.channels))
        case Cause.LENGTH_SCALE:
            lengths = np.repeat([1.0 / value[0], 1.0], [3, 4])
            return _changed(recording, verdict.robot, lambda robot: replace(robot, pose=pose_of(robot) * lengths))
        case Cause.GRAVITY | Cause.NOT_LEVEL:
            assert verdict.gravity is not None
            return _in_level_homes(recording, verdict.gravity)
        case Cause.INVERSE:
            return _changed(recording, None, lambda robot: replace(robot, pose=inverse_poses(pose_of(robot))))
        case cause:
            raise RecordingError(f"nothing says what sensors would have read without '{cause}': {verdict.words}")


def _changed(recording: Recording, name: str | None, change: Callable[[RobotRecord], RobotRecord]) -> Recording:
    """Change one robot's record; None: all robots'."""
    robots = {own: change(robot) if name in (None, own) else robot for own, robot in recording.robots.items()}
    return replace(recording, robots=robots)


def pose_of(robot: RobotRecord) -> Array:
    """Of a robot whose poses were recorded."""
    assert robot.pose is not None
    return robot.pose


def wrench_of(robot: RobotRecord) -> Array:
    """Of a robot whose wrenches were recorded."""
    assert robot.wrench is not None
    return robot.wrench


def _rotations(robot: RobotRecord) -> Array:
    return Rotation.from_quat(pose_of(robot)[:, 3:]).as_matrix()


def _with_moment_about(robot: RobotRecord, lever: Array) -> RobotRecord:
    """Take moments about the origin of the grasp frame, which is at ``lever`` (3,) from their present point."""
    wrench = wrench_of(robot)
    return replace(robot, wrench=np.hstack([wrench[:, :3], wrench[:, 3:] - np.cross(lever, wrench[:, :3])]))


def _scaled(robot: RobotRecord, factors: Array) -> RobotRecord:
    return replace(robot, wrench=wrench_of(robot) * factors)


def _turned(robot: RobotRecord, rotations: Array) -> RobotRecord:
    """Rotate forces and moments by rotations (n, 3, 3) or one (1, 3, 3)."""
    halves = wrench_of(robot).reshape(-1, 2, 3)
    return replace(robot, wrench=(halves @ rotations.swapaxes(-1, -2)).reshape(-1, 6))


def _earlier(robot: RobotRecord, delay: float, channels: Sequence[str]) -> RobotRecord:
    """Shift channels to an earlier time by ``delay`` [s]; at the ends, repeat the last sample."""
    at = robot.time + delay
    moved = {}
    for channel in channels:
        samples = getattr(robot, channel)
        moved[channel] = np.stack([np.interp(at, robot.time, column) for column in samples.T], axis=-1)
    if "pose" in moved:
        moved["pose"][:, 3:] /= np.linalg.norm(moved["pose"][:, 3:], axis=1, keepdims=True)
    return replace(robot, **moved)


def _in_level_homes(recording: Recording, gravity: Array) -> Recording:
    """Rotate the home frames such that gravity, which is (N, 3) in them, becomes the recording's."""
    robots = {}
    for (name, robot), down in zip(recording.robots.items(), gravity, strict=True):
        turn, _ = Rotation.align_vectors(recording.gravity[None], down[None])
        pose = pose_of(robot)
        turned = (turn * Rotation.from_quat(pose[:, 3:])).as_quat()
        robots[name] = replace(robot, pose=np.hstack([turn.apply(pose[:, :3]), turned]))
    return replace(recording, robots=robots)

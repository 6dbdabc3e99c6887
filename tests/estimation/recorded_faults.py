"""Faults of recordings, as functions of what a robot without them would have recorded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.estimation.batch.recording import Recording, RobotRecord
from coheft.estimation.geometry.spatial import Array

Fault = Callable[[Array, Array], tuple[Array, Array]]
"""From pose (n, 7) and wrench (n, 6) of a robot to what it recorded."""


def with_fault(recording: Recording, fault: Fault, *names: str) -> Recording:
    """What was recorded if robots, the second one if none is named, had a fault."""
    robots = dict(recording.robots)
    for name in names or ("r2",):
        pose, wrench = robots[name].pose, robots[name].wrench
        assert pose is not None
        assert wrench is not None
        pose, wrench = fault(pose.copy(), wrench.copy())
        robots[name] = RobotRecord(recording.time, pose=pose, wrench=wrench)
    return replace(recording, robots=robots)


def to_wrench(change: Callable[[Array], Array]) -> Fault:
    return lambda pose, wrench: (pose, change(wrench))


def lever(wrench: Array) -> Array:
    return np.hstack([wrench[:, :3], wrench[:, 3:] + np.cross([0.02, 0.0, -0.03], wrench[:, :3])])


def in_home_axes(pose: Array, wrench: Array) -> tuple[Array, Array]:
    turn = Rotation.from_quat(pose[:, 3:])
    return pose, np.hstack([turn.apply(wrench[:, :3]), turn.apply(wrench[:, 3:])])


def half_in_home_axes(half: int) -> Fault:
    """Only the forces (0) or the moments (1) are in the axes of the home frame."""

    def fault(pose: Array, wrench: Array) -> tuple[Array, Array]:
        _, turned = in_home_axes(pose, wrench)
        return pose, np.where(np.arange(6) // 3 == half, turned, wrench)

    return fault


def about_home(point: tuple[float, float, float] = (0.0, 0.0, 0.0), *, is_turned: bool = False) -> Fault:
    """Moments about a point of the home frame, in the axes of the grasp frame or, if turned, of the home frame."""

    def fault(pose: Array, wrench: Array) -> tuple[Array, Array]:
        arm = Rotation.from_quat(pose[:, 3:]).inv().apply(pose[:, :3] - point)
        wrench[:, 3:] += np.cross(arm, wrench[:, :3])
        return in_home_axes(pose, wrench) if is_turned else (pose, wrench)

    return fault


def one_axis(axis: int, factor: float) -> Fault:
    return to_wrench(lambda wrench: wrench * np.where(np.arange(6) == axis, factor, 1.0))


def home_turned(axis: Array) -> Fault:
    turn = Rotation.from_rotvec(axis)

    def fault(pose: Array, wrench: Array) -> tuple[Array, Array]:
        return np.hstack([turn.apply(pose[:, :3]), (turn * Rotation.from_quat(pose[:, 3:])).as_quat()]), wrench

    return fault


def weight(mass: float) -> Fault:
    """Of a tool that is not compensated, 5 cm above the grasp; if negative, a controller compensates too much."""

    def fault(pose: Array, wrench: Array) -> tuple[Array, Array]:
        force = Rotation.from_quat(pose[:, 3:]).inv().apply([0.0, 0.0, 9.81 * mass])
        return pose, wrench + np.hstack([force, np.cross([0.0, 0.0, 0.05], force)])

    return fault


def turned(wrench: Array) -> Array:
    """By a mounting that is a third of a right angle off."""
    turn = Rotation.from_euler("z", 30.0, degrees=True)
    return np.hstack([turn.apply(wrench[:, :3]), turn.apply(wrench[:, 3:])])


def exchanged(wrench: Array) -> Array:
    """Columns y and z."""
    return wrench[:, [0, 2, 1, 3, 5, 4]]


def drifting(wrench: Array) -> Array:
    return wrench + np.linspace(0.0, 1.0, len(wrench))[:, None] * [2.0, 0.0, 1.0, 0.0, 0.0, 0.0]


def late(wrench: Array) -> Array:
    """By three samples, 30 ms."""
    return np.concatenate([np.repeat(wrench[:1], 3, axis=0), wrench[:-3]])

"""Synthetic experiments for batch estimation: exact signals of robots that hold one body, and noise to add."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.estimation.batch.recording import Recording, RobotRecord, Truth
from coheft.estimation.batch.signals import Signals
from coheft.estimation.geometry.body_motion import grasp_measurements
from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp
from coheft.estimation.measurement import ACCELERATION, TWIST, WRENCH, SensorNoise
from coheft.estimation.rigid_body.mass_properties import Inertia
from tests.estimation.team import body_motion, random_pose

RATE = 100.0
LOAD = Inertia(8.0, np.array([0.3, -0.1, 0.15]), np.array([[1.5, 0.1, -0.2], [0.1, 2.1, 0.05], [-0.2, 0.05, 2.9]]))


def grasps(rng: np.random.Generator, count: int = 3) -> tuple[Pose, ...]:
    """Poses in the first one."""
    return (Pose.identity(), *(random_pose(rng) for _ in range(count - 1)))


def exact_signals(
    rng: np.random.Generator,
    poses: tuple[Pose, ...],
    seconds: float = 20.0,
    motion: Array | None = None,
    load: Inertia = LOAD,
) -> Signals:
    """What robots feel without noise while the load swings; each pushes with a random share of what is needed.

    Instead of swinging it may have another ``motion`` (n, 12), of the first grasp frame.
    """
    if motion is None:
        motion = body_motion(rng, np.arange(int(seconds * RATE)) / RATE)
    time = np.arange(len(motion)) / RATE
    own = np.array([grasp_measurements(pose, motion) for pose in poses])
    total = load.wrench(motion[:, :3], motion[:, 6:9], motion[:, 9:])
    pushes = rng.normal(size=(len(poses) - 1, len(time), 6))
    shares = [total - pushes.sum(axis=0), *pushes]
    wrench = np.array([share @ np.linalg.inv(pose.adjoint()).T for share, pose in zip(shares, poses, strict=True)])
    alpha = np.array([motion[:, 9:] @ pose.rotation for pose in poses])
    return Signals(time, own[..., :3], own[..., 3:6], alpha, own[..., 6:9], wrench, None)


def with_noise(rng: np.random.Generator, signals: Signals, w: float, v: float, alpha: float, a: float) -> Signals:
    """Independent white noise on every robot's motion, of these standard deviations."""

    def noisy(exact: Array, size: float) -> Array:
        result: Array = exact + size * rng.normal(size=exact.shape)
        return result

    return replace(
        signals,
        w=noisy(signals.w, w),
        v=noisy(signals.v, v),
        alpha=noisy(signals.alpha, alpha),
        a=noisy(signals.a, a),
    )


def sliding(seconds: float = 20.0) -> Array:
    """Motion (n, 12) of a load that never turns and slides to and fro along x, gravity along -z."""
    time = np.arange(int(seconds * RATE)) / RATE
    rate = 2.0 * np.pi * 0.7
    motion = np.zeros((len(time), 12))
    motion[:, 3], motion[:, 6] = 0.1 * rate * np.cos(rate * time), -0.1 * rate**2 * np.sin(rate * time)
    motion[:, 8] = 9.81
    return motion


def sensors_recording(rng: np.random.Generator, signals: Signals, noise: SensorNoise) -> Recording:
    """What sensors with white noise record of exact signals."""
    assert signals.wrench is not None
    robots = {}
    for k, wrench in enumerate(signals.wrench):
        own = np.hstack([signals.w[k], signals.v[k], signals.a[k], wrench])
        own += noise.per_column() * rng.normal(size=own.shape)
        robots[f"r{k + 1}"] = RobotRecord(
            signals.time, twist=own[:, TWIST], acceleration=own[:, ACCELERATION], wrench=own[:, WRENCH]
        )
    return Recording(robots, noise=noise)


def moving_recording(rng: np.random.Generator, poses: tuple[Pose, ...], seconds: float = 20.0) -> Recording:
    """Exact poses of robots in home frames that stand anywhere.

    World and load are the home and the grasp frame of the first robot.
    """
    time = np.arange(int(seconds * RATE)) / RATE
    phases = rng.uniform(0.0, 2.0 * np.pi, (2, 6))
    rates = 2.0 * np.pi * rng.uniform(0.1, 0.5, (2, 6))
    waves = np.sin(rates * time[:, None, None] + phases).sum(axis=1)
    rotations = Rotation.from_rotvec(0.15 * waves[:, :3]).as_matrix()
    positions = 0.08 * waves[:, 3:]
    robots = {}
    for k, pose in enumerate(poses):
        yaw = rotation_exp(np.array([0.0, 0.0, rng.uniform(-3.0, 3.0)]))
        home = Pose.identity() if k == 0 else Pose(yaw, rng.normal(size=3))
        own = home.rotation.T @ rotations @ pose.rotation
        place = (rotations @ pose.translation + positions - home.translation) @ home.rotation
        robots[f"r{k + 1}"] = RobotRecord(time, pose=np.hstack([place, Rotation.from_matrix(own).as_quat()]))
    return Recording(robots, truth=Truth(poses, ((0.0, LOAD),)))

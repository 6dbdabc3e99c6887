"""Synthetic experiments for batch estimation: exact signals of robots that hold one body, and noise to add."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.estimation.batch.recording import Recording, RobotRecord, Truth
from coheft.estimation.batch.signals import Signals
from coheft.estimation.geometry.body_motion import BODY_A, BODY_ALPHA, BODY_V, BODY_W, grasp_measurements
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
    return Signals(time, np.concatenate([own, alpha], axis=-1), own[..., 6:9], wrench, None)


def with_noise(rng: np.random.Generator, signals: Signals, w: float, v: float, alpha: float, a: float) -> Signals:
    """Independent white noise on every robot's motion, of these standard deviations."""
    motion = signals.motion.copy()
    for part, size in ((BODY_W, w), (BODY_V, v), (BODY_ALPHA, alpha), (BODY_A, a)):
        motion[..., part] += size * rng.normal(size=motion[..., part].shape)
    return replace(signals, motion=motion)


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
    robots = {}
    for k, wrench in enumerate(signals.wrench):
        own = np.hstack([signals.motion[k][:, :9], wrench])
        own += noise.per_column() * rng.normal(size=own.shape)
        robots[f"r{k + 1}"] = RobotRecord(
            signals.time, twist=own[:, TWIST], acceleration=own[:, ACCELERATION], wrench=own[:, WRENCH]
        )
    return Recording(robots, noise=noise)


def moving_recording(rng: np.random.Generator, poses: tuple[Pose, ...], seconds: float = 20.0) -> Recording:
    """Exact poses of robots in home frames that stand anywhere; they exert nothing.

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
        pose = np.hstack([place, Rotation.from_matrix(own).as_quat()])
        robots[f"r{k + 1}"] = RobotRecord(time, pose=pose, wrench=np.zeros((len(time), 6)))
    return Recording(robots, truth=Truth(poses, ((0.0, LOAD),)))


HELD = Inertia(6.2, np.array([0.04, -0.03, 0.06]), np.diag([0.11, 0.24, 0.29]))
HELD_GRASPS = (
    Pose(rotation_exp(np.array([0.0, 0.0, 0.35])), np.array([-0.35, 0.0, 0.05])),
    Pose(rotation_exp(np.array([0.17, 0.0, 2.9])), np.array([0.35, 0.1, 0.0])),
    Pose(rotation_exp(np.array([0.0, 0.26, -1.6])), np.array([0.0, -0.25, 0.1])),
)
HELD_NOISE = (1e-4, 2e-4, 0.2, 0.02)
"""Of positions [m], turns [rad], forces [N] and moments [N·m], per sample."""


@cache
def held_recording(
    seed: int,
    count: int = 3,
    seconds: float = 25.0,
    change: tuple[float, Inertia] | None = None,
    *,
    speed: float = 1.0,
    turns: tuple[float, float, float] = (1.0, 1.0, 1.0),
    shifts: float = 1.0,
) -> Recording:
    """Poses and wrenches, with noise, of robots that swing a load and push against each other; not to be changed.

    Args:
        seed: Of noise, motion and pushes.
        count: Of robots.
        seconds: How long.
        change: From when on another body is there, and which [s].
        speed: Of the motion, in multiples of the usual.
        turns: Sizes of rotations about the axes, in multiples of the usual.
        shifts: Size of translations, in multiples of the usual.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(int(seconds * RATE)) / RATE
    rates, phases = speed * rng.uniform(1.2, 3.0, (4, 3)), rng.uniform(0.0, 6.0, (4, 3))

    def pose_at(t: Array) -> tuple[Rotation, Array]:
        turn, shift, small = (np.sin(rates[k] * t[:, None] + phases[k]) for k in range(3))
        return Rotation.from_euler("xyz", (0.25 * turn + 0.05 * small) * turns), 0.07 * shifts * shift

    step = 1e-4
    (before, behind), (now, place), (after, ahead) = (pose_at(time + k * step) for k in (-1, 0, 1))
    (early, _), (late, _) = (pose_at(time + k * step) for k in (-2, 2))
    w = (before.inv() * after).as_rotvec() / (2 * step)
    alpha = ((now.inv() * late).as_rotvec() - (early.inv() * now).as_rotvec()) / (2 * step) ** 2
    a = now.inv().apply((ahead - 2 * place + behind) / step**2 + [0.0, 0.0, 9.81])
    total = HELD.wrench(w, a, alpha)
    if change is not None:
        total[time >= change[0]] = change[1].wrench(w, a, alpha)[time >= change[0]]
    pushes = rng.normal(size=(count, 6)) * np.repeat([1.5, 0.15], 3)
    shares = [total / count + (own - pushes.mean(axis=0)) * np.sin(1.1 * time[:, None]) for own in pushes]
    robots = {}
    for k, (grasp, share) in enumerate(zip(HELD_GRASPS[:count], shares, strict=True)):
        yaw = Rotation.from_euler("z", 0.7 * k).inv()
        own_place = yaw.apply(place + now.apply(grasp.translation) - [0.3 * k, 0.1, 0.0])
        own_turn = yaw * now * Rotation.from_matrix(grasp.rotation)
        sizes = (len(time), 3)
        noise = [size * rng.normal(size=sizes) for size in HELD_NOISE]
        own_turn = own_turn * Rotation.from_rotvec(noise[1])
        wrench = share @ np.linalg.inv(grasp.adjoint()).T + np.hstack(noise[2:])
        robots[f"r{k + 1}"] = RobotRecord(
            time, pose=np.hstack([own_place + noise[0], own_turn.as_quat()]), wrench=wrench
        )
    first = HELD_GRASPS[0].inverse()
    truth = Truth(tuple(first @ grasp for grasp in HELD_GRASPS[:count]), ((0.0, HELD.transported(first)),))
    return Recording(robots, truth=truth)

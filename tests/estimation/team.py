"""Synthetic teams: robots that hold one moving rigid body, with exact measurements and noisy ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coheft.estimation.geometry.body_motion import grasp_measurements
from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.rigid_body.mass_properties import Inertia

GRAVITY = np.array([0.0, 0.0, -9.81])


def random_pose(rng: np.random.Generator, angle: float = 1.0, distance: float = 0.5) -> Pose:
    return Pose(rotation_exp(angle * rng.normal(size=3)), distance * rng.normal(size=3))


def smooth(rng: np.random.Generator, time: Array, amplitude: float, axes: int = 3) -> tuple[Array, Array, Array]:
    """Two sinusoids of 0.4 to 1.6 Hz per axis, and their first and second derivatives, shape (n, axes) each."""
    rate = 2.0 * np.pi * rng.uniform(0.4, 1.6, (2, 1, axes))
    phase = rate * time[:, None] + rng.uniform(0.0, 2.0 * np.pi, (2, 1, axes))
    x, dx, ddx = np.sin(phase), rate * np.cos(phase), -(rate**2) * np.sin(phase)
    return tuple(amplitude * part.sum(axis=0) / np.sqrt(2.0) for part in (x, dx, ddx))  # type: ignore[return-value]


def body_motion(
    rng: np.random.Generator, time: Array, rotation: float = 0.1, translation: float = 0.06, single_axis: bool = False
) -> Array:
    """Exact motion (n, 12) of a frame whose orientation is ``Rz(c) Ry(b) Rx(a)`` with smooth angles."""
    angles, rates, accelerations = smooth(rng, time, rotation)
    position = smooth(rng, time, translation)
    if single_axis:
        for part in (angles, rates, accelerations):
            part[:, :2] = 0.0
    a, b, c = angles.T
    o = np.zeros_like(a)
    # Axes of the three rates in the moving frame, and how these axes change.
    x_axis = np.stack([o + 1, o, o], axis=1)
    y_axis = np.stack([o, np.cos(a), -np.sin(a)], axis=1)
    z_axis = np.stack([-np.sin(b), np.cos(b) * np.sin(a), np.cos(b) * np.cos(a)], axis=1)
    da, db = rates[:, :1], rates[:, 1:2]
    dy_axis = da * np.stack([o, -np.sin(a), -np.cos(a)], axis=1)
    dz_axis = da * np.stack([o, np.cos(b) * np.cos(a), -np.cos(b) * np.sin(a)], axis=1) + db * np.stack(
        [-np.cos(b), -np.sin(b) * np.sin(a), -np.sin(b) * np.cos(a)], axis=1
    )
    w = np.einsum("nk,knx->nx", rates, [x_axis, y_axis, z_axis])
    alpha = np.einsum("nk,knx->nx", accelerations, [x_axis, y_axis, z_axis])
    alpha += rates[:, 1:2] * dy_axis + rates[:, 2:] * dz_axis
    z, y, x = (
        [rotation_exp(angle * axis) for angle in part] for part, axis in zip((c, b, a), np.eye(3)[::-1], strict=True)
    )
    rotations = np.array(z) @ np.array(y) @ np.array(x)
    v = np.einsum("nij,ni->nj", rotations, position[1])
    proper = np.einsum("nij,ni->nj", rotations, position[2] - GRAVITY)
    return np.concatenate([w, v, proper, alpha], axis=1)


@dataclass(frozen=True, eq=False)
class Team:
    """N robots on a rim around a 20 kg load; the body frame is the grasp frame of the first.

    Attributes:
        poses: Of every ``F_i`` in the body frame.
        inertia: In the body frame.
        motion: Of the body frame, shape (n, 12).
        exact: What noise-free sensors read, each robot in its own frame, shape (n, N, 15).
        noise: Of the sensors.
    """

    poses: tuple[Pose, ...]
    inertia: Inertia
    motion: Array
    exact: Array
    noise: SensorNoise

    def measured(self, rng: np.random.Generator) -> Array:
        """Samples (n, N, 15) with noise."""
        result: Array = self.exact + rng.normal(size=self.exact.shape) * self.noise.per_column()
        return result


def make_team(
    seed: int,
    count: int = 6,
    rate: float = 100.0,
    duration: float = 20.0,
    noise: SensorNoise | None = None,
    squeeze: float = 10.0,
    single_axis: bool = False,
) -> Team:
    """A team with random orientations of the grasps; ``squeeze`` is the amplitude of internal forces [N]."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(duration * rate)) / rate
    rim = 2.0 * np.pi * np.arange(count) / count
    at = np.stack([0.55 * np.cos(rim), 0.4 * np.sin(rim), rng.uniform(-0.05, 0.05, count)], axis=1)
    in_payload = [Pose(rotation_exp(rng.normal(size=3)), position) for position in at]
    poses = tuple(in_payload[0].inverse() @ pose for pose in in_payload)
    payload = Inertia(20.0, np.array([0.05, -0.03, 0.02]), np.diag([1.2, 1.9, 2.8]) + 0.1)
    inertia = payload.transported(in_payload[0].inverse())
    in_middle = body_motion(rng, time, single_axis=single_axis)
    motion = np.concatenate(
        [grasp_measurements(in_payload[0], in_middle), in_middle[:, 9:] @ in_payload[0].rotation], axis=1
    )
    missing = inertia.wrench(motion[:, :3], motion[:, 6:9], motion[:, 9:])
    share = missing[:, :3] / count
    wrenches = np.empty((len(time), count, 6))
    for i in range(1, count):
        wrenches[:, i, :3] = share @ poses[i].rotation + smooth(rng, time, squeeze)[0]
        wrenches[:, i, 3:] = smooth(rng, time, 0.1 * squeeze)[0]
        missing = missing - wrenches[:, i] @ poses[i].adjoint().T
    wrenches[:, 0] = missing
    kinematics = np.stack([grasp_measurements(pose, motion) for pose in poses], axis=1)
    exact = np.concatenate([kinematics, wrenches], axis=2)
    return Team(poses, inertia, motion, exact, noise or SensorNoise())

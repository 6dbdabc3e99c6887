"""Rows of four robots that move a load along a made-up path, with noise."""

from __future__ import annotations

import numpy as np

from coheft.estimation.geometry.body_motion import grasp_measurements
from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.moments.rows import row_of_samples
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.estimation.rigid_body.regressor import features, regressor_coefficients

RATE, BLOCK = 1000, 20
PERIOD = BLOCK / RATE
POSES = tuple(
    Pose(rotation_exp(turn), np.array(position))
    for turn, position in (
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((0.3, -0.2, 1.5), (-0.8, 0.1, 0.05)),
        ((0.1, 0.4, 3.0), (-0.7, -0.6, 0.0)),
        ((-0.5, 0.1, -1.2), (0.1, -0.5, -0.1)),
    )
)
"""In the frame of the first one."""
LOAD: Array = Inertia(8.0, np.array([-0.35, -0.25, 0.02]), np.diag([0.6, 0.8, 1.1])).barycentric()


def made_up_rows(
    count: int,
    load: Array = LOAD,
    first: int = 0,
    seed: int = 1,
    poses: tuple[Pose, ...] = POSES,
    axes: tuple[float, ...] = (1.0, 1.0, 1.0),
) -> Array:
    """Rows (count, 24 N + 1) from number ``first`` on; the load turns about these axes."""
    rng = np.random.default_rng((seed, first))
    noise = SensorNoise()
    times = (np.arange(count * BLOCK) + first * BLOCK) / RATE
    motion = _motion(times, np.array(axes))
    wrench = np.einsum("nk,kij,j->ni", features(motion, np.zeros((len(times), 6))), _regressor(), load)
    shares = np.random.default_rng(5).dirichlet(np.ones(len(POSES)))
    rows = np.ones((count, 24 * len(POSES) + 1))
    for robot, pose in enumerate(poses):
        own = np.hstack([grasp_measurements(pose, motion), shares[robot] * wrench @ pose.inverse().adjoint().T])
        own += rng.normal(size=own.shape) * noise.per_column()
        for number, samples in enumerate(own.reshape(count, BLOCK, 15)):
            rows[number, 24 * robot : 24 * robot + 24] = row_of_samples(samples, noise.gyro**2, RATE)
    return rows


def _regressor() -> Array:
    return regressor_coefficients(with_offset=False)[:, :, :10]


def _motion(times: Array, axes: Array) -> Array:
    """Body motion ``(w, v, a, alpha)`` of sums of sines, gravity in the acceleration, shape (n, 12)."""
    rng = np.random.default_rng(3)
    frequencies, phases = rng.uniform(0.3, 1.2, size=(2, 6, 3)) * [[[2 * np.pi]], [[3.0]]]
    angle = times[:, None, None] * frequencies + phases
    turning, moving = 0.25 * axes, 0.4 * np.ones(3)
    w = (turning * np.cos(angle[:, :3])).sum(axis=1)
    alpha = (-turning * frequencies[:3] * np.sin(angle[:, :3])).sum(axis=1)
    v = (moving * np.cos(angle[:, 3:])).sum(axis=1)
    acceleration = (-moving * frequencies[3:] * np.sin(angle[:, 3:])).sum(axis=1)
    tilt = (turning / frequencies[:3] * np.sin(angle[:, :3])).sum(axis=1)
    down = rotation_exp(tilt) @ np.array([0.0, 0.0, 9.81])
    return np.hstack([w, v, acceleration + down, alpha])

"""A made-up motion of a body that six robots hold, and what their sensors read: what kernels are timed on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coheft.estimation.body_motion import grasp_measurements
from coheft.estimation.inertia import features, regressor_coefficients
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.motion_fusion import CHANNELS, MotionFusion, derivative_kernel, summands
from coheft.estimation.spatial import Array, Pose

ROBOTS = 6
RATE = 1000
PARAMETERS = np.array([10.0, 0.4, -0.2, 0.1, 0.6, 1.1, 1.5, 0.05, -0.04, 0.02])
"""``(m, m h, I_o)`` of the load."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of all robots.

    Attributes:
        poses: Of the grasp frames in the body frame, of which the first is the body frame itself.
        motion: Of the body, shape (n, 12), without noise.
        wrench: Total, in the body frame, with noise, shape (n, 6).
        sensed: What each robot measures, shape (N, n, 15): its kinematics, and an equal share of the wrench.
        sums: What the network's sums over ``summands`` are, shape (n, 3, 6).
        noise: Of the sensors.
        fusion: Turns the sums into motion.
    """

    poses: list[Pose]
    motion: Array
    wrench: Array
    sensed: Array
    sums: Array
    noise: SensorNoise
    fusion: MotionFusion

    @staticmethod
    def make(count: int, seed: int = 1) -> Samples:
        """So many samples."""
        rng = np.random.default_rng(seed)
        noise = SensorNoise()
        poses = [Pose.identity()] + [Pose.exp(0.6 * rng.normal(size=6)) for _ in range(ROBOTS - 1)]
        motion = _motion(count, rng)
        wrench = features(motion, np.zeros((count, 6))) @ _wrench_of_features()
        wrench += rng.normal(size=wrench.shape) * np.repeat([noise.force, noise.torque], 3)
        sensed = np.zeros((ROBOTS, count, 15))
        for readings, pose in zip(sensed, poses, strict=True):
            readings[:, :9] = grasp_measurements(pose, motion)
            readings[:, :9] += rng.normal(size=(count, 9)) * noise.per_column()[:9]
            readings[:, 9:] = wrench @ pose.inverse().adjoint().T / ROBOTS
        sums = sum(
            (summands(readings, noise) @ pose.adjoint().T for readings, pose in zip(sensed, poses, strict=True)),
            np.zeros((count, CHANNELS // 6, 6)),
        )
        fusion = MotionFusion.of_robots(noise, poses, derivative_kernel(10, 1.0 / RATE))
        return Samples(poses, motion, wrench, sensed, sums, noise, fusion)


def _motion(count: int, rng: np.random.Generator) -> Array:
    """``(w, v, a, alpha)`` of two sinusoids per axis."""
    time = np.arange(count)[:, None] / RATE
    w, v, a, alpha = (np.zeros((count, 3)) for _ in range(4))
    a[:, 2] += 9.81
    for _ in range(2):
        omega, phase = 2.0 * np.pi * rng.uniform(0.4, 1.6, 3), rng.uniform(0.0, 2.0 * np.pi, 3)
        size, speed = rng.uniform(0.3, 0.8, 3), rng.uniform(0.1, 0.3, 3)
        w += size * np.sin(omega * time + phase)
        alpha += size * omega * np.cos(omega * time + phase)
        v += speed * np.cos(omega * time - phase)
        a -= speed * omega * np.sin(omega * time - phase)
    return np.hstack([w, v, a, alpha])


def _wrench_of_features() -> Array:
    """Takes features (19) to the wrench that the load takes (6)."""
    result: Array = regressor_coefficients(with_offset=False)[:, :, :-1] @ PARAMETERS
    return result

"""Readings of the robots' encoders and drives: grasp poses and forces, with errors."""

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.estimation.batch.wrist_poses import gimbal_angles, gimbal_rotations
from coheft.estimation.geometry.spatial import Array
from coheft.wire.scenario.encoders import EncoderErrors
from coheft.wire.scenario.schema import Scenario

_STREAM = 1
"""Separates these random streams from those of ``Sensors``, whose readings do not depend on encoders."""


class Encoders:
    """Turns exact samples into readings. Each robot has its own calibration and its own random stream.

    Attributes:
        zero: Misalignment of the gimbals' zeros, shape (N, 3) [rad].
        angle_scale: Scale factors of the angles, shape (N, 3).
        position_scale: Scale factors of the positions, shape (N, 1).
        force_scale: Scale factors of the forces, shape (N, 1).
        force_offset: Offsets of the forces, shape (N, 3) [N].
    """

    def __init__(self, errors: EncoderErrors, scenario: Scenario) -> None:
        self._errors = errors
        self._force_noise = scenario.noise.force
        count = scenario.robot_count
        seeds = np.random.SeedSequence((scenario.seed, _STREAM)).spawn(count)
        self._streams = [np.random.default_rng(seed) for seed in seeds]
        own = [np.random.default_rng(seed) for seed in np.random.SeedSequence(errors.calibration_seed).spawn(count)]
        self.zero = np.radians([errors.misalignment_deg * rng.uniform(-1, 1) * _direction(rng) for rng in own])
        self.angle_scale = np.array([1.0 + errors.angle_scale * rng.uniform(-1, 1, 3) for rng in own])
        self.position_scale = np.array([1.0 + errors.position_scale * rng.uniform(-1, 1, 1) for rng in own])
        self.force_scale = np.array([1.0 + errors.force_scale * rng.uniform(-1, 1, 1) for rng in own])
        self.force_offset = np.array([errors.force_offset * rng.uniform(-1, 1, 3) for rng in own])

    def measure(self, positions: Array, rotations: Array, forces: Array) -> Array:
        """Return the readings of a block, and draw the noise of the robots' next B samples.

        Args:
            positions: Exact positions of the grasp frames in their home frames, shape (B, N, 3) [m].
            rotations: Exact rotations of the grasp frames in their home frames, shape (B, N, 3, 3).
            forces: Exact forces on the payload, in the axes of the home frames, shape (B, N, 3) [N].

        Returns:
            ``x y z qx qy qz qw`` of the grasp frame in its home frame, then force and torque in its own axes, shape
            (B, N, 13). The torque is zero: a gimbal transmits none.
        """
        samples, count = positions.shape[:2]
        noise = np.stack([stream.standard_normal((samples, 9)) for stream in self._streams], axis=1)
        errors = self._errors
        angles = gimbal_angles(rotations) + np.radians(errors.vibration_deg) * noise[..., :3]
        step = 2.0 * np.pi / 2**errors.angle_bits
        measured_rotations = gimbal_rotations(step * np.round((self.angle_scale * angles + self.zero) / step))
        scaled = self.position_scale * (positions + 1e-3 * errors.vibration_mm * noise[..., 3:6])
        measured_forces = self.force_scale * forces + self.force_offset + self._force_noise * noise[..., 6:]
        result = np.zeros((samples, count, 13))
        result[..., :3] = errors.position_step * np.round(scaled / errors.position_step)
        quaternions = Rotation.from_matrix(measured_rotations.reshape(-1, 3, 3)).as_quat(canonical=True)
        result[..., 3:7] = quaternions.reshape(samples, count, 4)
        result[..., 7:10] = (measured_forces[..., None, :] @ measured_rotations)[..., 0, :]
        return result


def _direction(rng: np.random.Generator) -> Array:
    """Return a unit vector (3,), uniform over the sphere."""
    vector = rng.standard_normal(3)
    return vector / np.linalg.norm(vector)

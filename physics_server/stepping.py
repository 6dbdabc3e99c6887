"""Stepping the engine through one block of samples."""

from dataclasses import dataclass

import mujoco
import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.physics_server.arms.impedance import Arms
from coheft.physics_server.sensors import READINGS

_FREE_JOINT = 7
"""Length of a free body's position; the payload's comes first."""


@dataclass(frozen=True, eq=False)
class Readings:
    """Exact readings of the engine at the B samples of a block.

    Attributes:
        positions: Position and quaternion of the payload, shape (B, 7).
        rotations: Rotation of the payload, shape (B, 3, 3).
        kinematics: ``(w, v, a)`` of each grasp frame, shape (B, N, 9).
        forces: Forces that the arms exert, see ``Arms.readings``, shape (B, 6 N).
    """

    positions: Array
    rotations: Array
    kinematics: Array
    forces: Array


def step(model: mujoco.MjModel, data: mujoco.MjData, arms: Arms, controls: Array, samples: int) -> Readings:
    """Step the engine through one block.

    Args:
        model: The engine's model; the payload's free joint and the sensors of the N grasp frames come first.
        data: The engine's state.
        arms: The arms, which drive the actuators.
        controls: Controls of the arms, shape (steps, 6 N).
        samples: Number B of samples.
    """
    data.qfrc_applied[:] = 0.0
    count = controls.shape[-1] // 6
    positions = np.empty((samples, _FREE_JOINT))
    rotations = np.empty((samples, 9))
    kinematics = np.empty((samples, count * READINGS))
    # Views, made once: the engine makes a new one at every access.
    position, quaternion = data.qpos[:_FREE_JOINT], data.qpos[3:_FREE_JOINT]
    readings, exerted = data.sensordata[: count * READINGS], arms.readings()
    forces = np.empty((samples, len(exerted)))
    drive, advance = arms.drive, mujoco.mj_step
    for sample, (first, *others) in enumerate(controls.reshape(samples, -1, controls.shape[-1])):
        drive(first)
        positions[sample] = position
        mujoco.mju_quat2Mat(rotations[sample], quaternion)
        advance(model, data)
        # Sensor readings, and with Euler's method all derived quantities, are of the state before the step.
        kinematics[sample] = readings
        forces[sample] = exerted
        for control in others:
            drive(control)
            advance(model, data)
    return Readings(positions, rotations.reshape(-1, 3, 3), kinematics.reshape(samples, count, READINGS), forces)

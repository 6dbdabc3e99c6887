"""The robots' sensors: exact readings of the engine, plus white noise and constant errors."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from coheft.estimation.geometry.spatial import Array, rotation_exp
from coheft.estimation.measurement import SAMPLE_SIZE
from coheft.estimation.tolerance import SENSORS, SHAPES, SensorTolerance
from coheft.wire.scenario.schema import Scenario

# Exactly w, v and the proper acceleration a of the grasp frame in its own axes; the order of a sample's columns.
_KINDS = {
    "gyro": mujoco.mjtSensor.mjSENS_GYRO,
    "velocity": mujoco.mjtSensor.mjSENS_VELOCIMETER,
    "acceleration": mujoco.mjtSensor.mjSENS_ACCELEROMETER,
}
READINGS = 3 * len(_KINDS)
"""Numbers that the engine's sensors read per robot."""


def add_sensors(spec: mujoco.MjSpec, site: str) -> None:
    """Add one robot's gyro, velocity sensor and accelerometer at its grasp site."""
    for name, kind in _KINDS.items():
        spec.add_sensor(name=f"{site}_{name}", type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=site)


class Sensors:
    """Turns exact readings into what the robots' sensors say.

    Each robot draws from a random stream of its own, so what it reads does not depend on how many others there are
    nor on how many samples travel in a block.

    Attributes:
        offsets: Constant errors of each robot, shape (N, 15), columns as in ``MeasurementBlock``.
        matrices: What each sensor makes of what it should read, shape (N, 5, 3, 3).
    """

    offsets: Array
    matrices: Array

    def __init__(self, scenario: Scenario, robots: Sequence[str]) -> None:
        seeds = np.random.SeedSequence(scenario.seed).spawn(len(robots))
        self._streams = [np.random.default_rng(seed) for seed in seeds]
        for stream in self._streams:
            stream.random(SAMPLE_SIZE)  # former releases drew errors here: so a seed still has the noise that it had
        errors, of_errors = scenario.sensor_errors, [np.random.default_rng(seed.spawn(1)[0]) for seed in seeds]
        self.offsets = errors.offsets() * np.array([stream.standard_normal(SAMPLE_SIZE) for stream in of_errors])
        self.matrices = np.array([_drawn_matrices(errors, stream) for stream in of_errors])
        self._deviation = scenario.noise.per_column()

    def measure(self, kinematics: Array, wrenches: Array) -> Array:
        """One block of measurements; draws the noise of the robots' next B samples.

        Args:
            kinematics: Exact ``(w, v, a)``, shape (B, N, 9).
            wrenches: Exact ``(f, t)``, shape (B, N, 6).

        Returns:
            Shape (N, B, 15), columns as in ``MeasurementBlock``.
        """
        samples, count = kinematics.shape[:2]
        measured = np.empty((count, samples, SAMPLE_SIZE))
        for stream, rows in zip(self._streams, measured, strict=True):
            stream.standard_normal(out=rows)
        measured *= self._deviation
        measured += self.offsets[:, None]
        exact = np.concatenate([kinematics, wrenches], axis=2).swapaxes(0, 1).reshape(count, samples, -1, 3, 1)
        measured += (self.matrices[:, None] @ exact).reshape(measured.shape)
        return measured


def _drawn_matrices(errors: SensorTolerance, stream: np.random.Generator) -> Array:
    """One robot's true matrices, shape (5, 3, 3), sensors in the order of ``SENSORS``."""
    result = []
    for sensor in SENSORS:
        drawn = {shape: errors.of(sensor, shape) * stream.standard_normal(len(each)) for shape, each in SHAPES.items()}
        mounting = rotation_exp(drawn.pop("mounting"))
        own = sum(np.tensordot(values, SHAPES[shape], axes=1) for shape, values in drawn.items())
        result.append((np.eye(3) + own) @ mounting)
    return np.array(result)

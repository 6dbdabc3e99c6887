"""The robots' sensors: exact readings of the engine with compliance, delay, rotation, scale, drift and white noise."""

from collections import deque
from collections.abc import Mapping

import mujoco
import numpy as np

from coheft.estimation.geometry.spatial import Array, rotation_from_quaternion
from coheft.estimation.measurement import KINEMATICS, SAMPLE_SIZE, WRENCH
from coheft.physics_server.compliance import CompliantGrasps
from coheft.physics_server.sensor_errors import SensorErrors
from coheft.wire.scenario.schema import Scenario

# The engine's exact w, v and proper acceleration a of the grasp frame in its own axes, in the order of columns.
_KINDS = {
    "gyro": mujoco.mjtSensor.mjSENS_GYRO,
    "velocity": mujoco.mjtSensor.mjSENS_VELOCIMETER,
    "acceleration": mujoco.mjtSensor.mjSENS_ACCELEROMETER,
}
LATEST = 1.0
"""Largest value to which a clock may be set during a run [s]."""
READINGS = 3 * len(_KINDS)
"""Number of readings of the engine's sensors per robot."""


def add_sensors(spec: mujoco.MjSpec, site: str, places: Mapping[str, Array]) -> None:
    """Add a robot's gyro, velocity sensor and accelerometer at its grasp site, or at places (3,) [m] in its frame."""
    at_grasp = spec.site(site)
    for name, kind in _KINDS.items():
        where, place = site, places.get(name, np.zeros(3))
        if place.any():
            where = f"{site}_at_{name}"
            position = at_grasp.pos + rotation_from_quaternion(at_grasp.quat) @ place
            at_grasp.parent.add_site(name=where, pos=position, quat=at_grasp.quat)
        spec.add_sensor(name=f"{site}_{name}", type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=where)


class Sensors:
    """Turns exact readings into the robots' measurements.

    Each robot draws from its own random stream, so its readings depend neither on the number of robots nor on the
    number of samples per block.
    """

    def __init__(self, scenario: Scenario, errors: SensorErrors) -> None:
        seeds = np.random.SeedSequence(scenario.seed).spawn(len(errors.offsets))
        self._streams = [np.random.default_rng(seed) for seed in seeds]
        for stream in self._streams:
            stream.random(SAMPLE_SIZE)  # earlier releases drew errors here; this keeps the noise of a seed the same
        self._errors = errors
        self._is_exact = bool((errors.matrices == np.eye(3)).all())
        missing = (own.is_missing() for own in scenario.robot_sensors())
        self._missing = {robot: columns for robot, columns in enumerate(missing) if columns.any()}
        self._deviations = np.array([own.noise.per_column() for own in scenario.robot_sensors()])[:, None]
        self._wander = scenario.sensor_drift.per_column() / np.sqrt(60.0 * scenario.sensors.rate)
        self._wanders = [np.random.default_rng(seed.spawn(2)[1]) for seed in seeds] if self._wander.any() else []
        self._wandered = np.zeros((len(seeds), SAMPLE_SIZE))
        correlation = scenario.sensors.noise_correlation
        self._alike = np.exp(-1.0 / (correlation * scenario.sensors.rate)) if correlation else 0.0
        self._noise_before: Array | None = None
        self._grasps = CompliantGrasps(errors.compliances, scenario.sensors.rate)
        self._rate = scenario.sensors.rate
        self._late = errors.delays * self._rate  # in samples
        # Exact samples of the last blocks, as many as the largest delay may need.
        longest = LATEST * self._rate + self._late.max()
        self._past: deque[Array] = deque(maxlen=1 + int(longest) // scenario.sensors.block)

    def measure(self, kinematics: Array, wrenches: Array) -> Array:
        """Return a block as in ``MeasurementBlock``, (N, B, 15); draws the noise of the robots' next B samples.

        Args:
            kinematics: Exact ``(w, v, a)``, shape (B, N, 9).
            wrenches: Exact ``(f, t)``, shape (B, N, 6).
        """
        samples, count = kinematics.shape[:2]
        measured = np.empty((count, samples, SAMPLE_SIZE))
        for stream, rows in zip(self._streams, measured, strict=True):
            stream.standard_normal(out=rows)
        if self._alike:
            self._correlate(measured)
        measured *= self._deviations
        measured += self._errors.offsets[:, None]
        for stream, rows, wandered in zip(self._wanders, measured, self._wandered, strict=False):
            walk = wandered + np.cumsum(self._wander * stream.standard_normal((samples, SAMPLE_SIZE)), axis=0)
            rows += walk
            wandered[:] = walk[-1]
        exact = self._grasps.displaced(np.concatenate([kinematics, wrenches], axis=2).swapaxes(0, 1))
        exact = self._delayed(exact)
        if not self._is_exact:
            vectors = exact.reshape(count, samples, -1, 3, 1)
            exact = (self._errors.matrices[:, None] @ vectors).reshape(measured.shape)
        measured += exact
        for robot, columns in self._missing.items():
            measured[robot][:, columns] = 0.0
        return measured

    def set_clock(self, robot: int, ahead: float) -> None:
        """Make a robot's samples older than their stamps by ``ahead`` [s] beside its delays, from the next block on."""
        self._late[robot] = (self._errors.delays[robot] + ahead) * self._rate

    def begin_anew(self, robot: int) -> None:
        """This robot lets go, takes hold, or slips before the next block."""
        self._grasps.begin_anew(robot)

    def _correlate(self, white: Array) -> None:
        """Turn white noise of variance 1, (N, B, 15), into Gauss-Markov noise of the first order, in place."""
        first = self._noise_before is None
        before = white[:, 0] if self._noise_before is None else self._noise_before
        fresh = np.sqrt(1.0 - self._alike**2)
        for sample in range(int(first), white.shape[1]):
            white[:, sample] = before = self._alike * before + fresh * white[:, sample]
        self._noise_before = before

    def _delayed(self, exact: Array) -> Array:
        """Return exact values at the delayed times, shape (N, B, 15), linearly interpolated between samples."""
        earlier = list(self._past) or [exact[:, :1]]
        self._past.append(exact)
        if not self._late.any():
            return exact
        kept, samples = int(np.ceil(self._late.max())), exact.shape[1]
        past = np.concatenate(earlier[-1 - kept // samples :], axis=1)
        if past.shape[1] < kept:  # the run begins at rest
            past = np.concatenate([np.repeat(past[:, :1], kept - past.shape[1], axis=1), past], axis=1)
        known, kept = np.concatenate([past, exact], axis=1), past.shape[1]
        result = np.empty_like(exact)
        for robot, late in enumerate(self._late):
            for columns, each in zip((KINEMATICS, WRENCH), late, strict=True):
                whole = int(each)
                first, share = kept - whole, each - whole
                now = known[robot, first : first + samples, columns]
                before = known[robot, max(first - 1, 0) : max(first - 1, 0) + samples, columns]
                result[robot, :, columns] = (1.0 - share) * now + share * before
        return result

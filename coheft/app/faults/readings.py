"""Effects of faulty sensors and clocks on a robot's measurements."""

import numpy as np

from coheft.app.faults.schedule import ClockSkew, FaultSchedule, SensorFault
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import ACCELERATION, FORCE, GYRO, TORQUE, VELOCITY

_COLUMNS = {"gyro": GYRO, "velocity": VELOCITY, "acceleration": ACCELERATION, "force": FORCE, "torque": TORQUE}
USUAL = {"gyro": 0.5, "velocity": 0.3, "acceleration": 10.0, "force": 30.0, "torque": 3.0}
"""Usual readings of a moving team's sensors: [rad/s], [m/s], [m/s²], [N], [N·m]."""
_OUTLIER = 10.0
"""Range of outliers, as a multiple of the usual reading."""


class Readings:
    """One robot's measurements as its agent receives them."""

    def __init__(self, schedule: FaultSchedule, robot: str) -> None:
        scenario = schedule.scenario
        self._block_duration = scenario.block_duration
        self._deviations = scenario.noise.per_column()
        self._skews = [f for f in schedule.faults if isinstance(f, ClockSkew) and f.robot == robot]
        faults = [f for f in schedule.faults if isinstance(f, SensorFault) and f.robot == robot]
        self._faults = [(fault, np.random.default_rng(fault.seed)) for fault in faults]
        self._signs = [rng.choice([-1.0, 1.0], size=3) for _, rng in self._faults]
        self._kept = max((skew.samples for skew in self._skews), default=0)
        self._past = np.zeros((0, 15))
        self._last: Array | None = None

    def read(self, block: int, samples: Array) -> Array:
        """Return the samples (B, 15) of a block with faults."""
        time = block * self._block_duration
        if self._skews:
            samples = self._late(samples, sum(skew.samples for skew in self._skews if skew.is_active(time)))
        for (fault, rng), signs in zip(self._faults, self._signs, strict=True):
            hit = self._hit(fault, time, len(samples))
            if hit.start < hit.stop:
                samples = samples.copy()
                last = samples[hit.start - 1].copy() if hit.start else self._last
                self._apply(samples[hit], fault, rng, signs, last)
        self._last = samples[-1]
        return samples

    def _hit(self, fault: SensorFault, time: float, count: int) -> slice:
        """Return the affected samples of a block: sensors may fail and recover within it."""
        first, end = (np.ceil((each - time) / self._block_duration * count - 1e-6) for each in (fault.start, fault.end))
        return slice(int(max(0, first)), int(min(count, end)))

    def _late(self, samples: Array, late: int) -> Array:
        """Return the measurements of ``late`` samples before; before the run, its first sample."""
        if len(self._past) == 0:
            self._past = np.tile(samples[0], (self._kept * len(self._skews), 1))
        self._past = np.concatenate([self._past, samples])
        end = len(self._past) - late
        taken = self._past[end - len(samples) : end]
        self._past = self._past[len(samples) :]
        return taken

    def _apply(
        self, samples: Array, fault: SensorFault, rng: np.random.Generator, signs: Array, last: Array | None
    ) -> None:
        """Apply a fault to samples in place; ``last`` is the sample before, if there is one."""
        columns, usual = _COLUMNS[fault.sensor], USUAL[fault.sensor]
        values = samples[:, columns]
        match fault.how:
            case "nan":
                values[rng.random(len(values)) < fault.size] = np.nan
            case "frozen":
                values[:] = samples[0, columns] if last is None else last[columns]
            case "outliers":
                hit = rng.random(len(values)) < fault.size
                values[hit] += rng.uniform(-_OUTLIER * usual, _OUTLIER * usual, size=(int(hit.sum()), 3))
            case "saturation":
                np.clip(values, -fault.size * usual, fault.size * usual, out=values)
            case "offset":
                values += fault.size * self._deviations[columns] * signs

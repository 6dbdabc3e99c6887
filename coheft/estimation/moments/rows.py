"""Rows: the means of one robot's samples over up to 20 ms (100 ms in large teams), in its own grasp frame.

    row = (mean w, mean v, mean a, slope of w, mean f, mean t, mean of w w^T packed),   24 numbers

The kinematics of a rigid body and the laws of Newton and Euler are linear in ``(w, v, a, alpha, F, T)`` and in the six
products ``w w^T``. They therefore hold exactly for means over any time, if the products are averaged as well. Averaging
loses a share ``(pi f T)^2 / 3`` of the information for a motion of frequency ``f`` [Hz]: 0.3 % at 1.6 Hz and ``T`` =
20 ms. Its noise is smaller by the root of the number of samples, so the bias that noise in regressors causes almost
disappears.

Where sensors may be late, a row is followed by its rates: how much it would change per second if it were made of
samples a moment later. For means these are the changes from the beginning of the row to its end, so they are right even
where something jumps in between. Their noise is independent of that of the row, but for that of the rates of ``w`` and
of the slope, which is neglected.

The slope of the gyro, a least-squares line through the row, is the angular acceleration up to a share
``(2 pi f T)^2 / 60``. Its noise is independent of that of the mean.

Where grasps are compliant, it is also followed by its flexing, with which a grasp moves against the load:

    displacement = c f,    velocity = c u1,    acceleration = c u2,        u1 = df/dt + w x f,    u2 = du1/dt + w x u1
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from coheft.estimation import measurement
from coheft.estimation.geometry.spatial import Array, rotation_exp
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.rigid_body.mass_properties import PACKED_COLUMNS, PACKED_ROWS

ROW_SIZE = 24
W, V, A, SLOPE = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
TWIST, ACCELERATIONS, KINEMATICS = slice(0, 6), slice(6, 12), slice(0, 12)
FORCE, TORQUE, WRENCH = slice(12, 15), slice(15, 18), slice(12, 18)
PRODUCTS = slice(18, 24)
KINEMATICS_SIZE, WRENCH_SIZE, FLEXING_SIZE = 12, 6, 6

LONGEST = 0.02
"""Longest duration of a row in teams of up to 32 [s]."""
_FASTEST, _FAST_TURNING, _TIMES = 2.0, 10.0, 3.0
"""Frequency [Hz] and angular acceleration [rad/s²] of a fast motion. Its effect on slopes does not average out, so it
counts as noise that is so many times larger."""
_SAMPLES = slice(0, 9), slice(9, 15)
"""Columns of samples: ``(w, v, a)`` and ``(f, t)``."""
_OF_SENSOR = {"gyro": (W, SLOPE), "velocity": (V,), "acceleration": (A,), "force": (FORCE,), "torque": (TORQUE,)}
"""Numbers of a row that a robot without this sensor does not measure, beside the products of its gyro."""
_FLAT_PRODUCTS = 3 * PACKED_ROWS + PACKED_COLUMNS
"""Entries of a raveled 3×3 matrix that are packed into six numbers."""
_MARGIN, _DEGREE = 0.06, 4
"""Time before and after a row of which forces are used [s], and the degree: up to 3 Hz this is right to 0.2 %, and with
0.02 mm/N the noise of forces is a quarter of that of the accelerometer. A parabola would be off by 4 % at 1.6 Hz."""


def rows_per_block(samples: int, rate: float, longest: float = LONGEST) -> int:
    """Return how many rows a block is cut into: the fewest of equal length that are short enough.

    Each has at least two samples, so that it has a slope. If no such number divides the block, rows are longer.

    Args:
        samples: Number of samples of a block.
        rate: Samples per second.
        longest: Duration of a row [s].
    """
    possible = [parts for parts in range(1, samples // 2 + 1) if samples % parts == 0]
    short_enough = [parts for parts in possible if samples <= parts * rate * longest + 1e-9]
    return min(short_enough, default=max(possible, default=1))


@dataclass(frozen=True, eq=False)
class RowNoise:
    """Effective standard deviations of the noise of rows.

    With slow noise a row adds little to the row before: its variance is multiplied by ``slowness``, so that means over
    many rows are as accurate as stated. The noise that moments of rows contain is that of a single row.

    A robot without one of the sensors has infinite noise there, so its numbers have no weight.

    Attributes:
        kinematics: Deviations of ``(w, v, a, slope)``, shape (N, 12), or (1, 12) if all robots are alike.
        wrench: Deviations of ``(f, t)``, shape (N, 6) or (1, 6).
        rates: Deviations of the rates of these 18 numbers, in deviations of the number itself, shape (N, 18) or (1, 18)
            [1/s].
        slowness: Effective variance over that of the noise of a single row; 1 for white noise.
        flexing: Deviations of ``(u1, u2)``, see ``flexing``, in deviations of the force, shape (6,) [1/s, 1/s²].
    """

    kinematics: Array
    wrench: Array
    rates: Array = field(default_factory=lambda: np.zeros((1, WRENCH.stop)))
    slowness: float = 1.0
    flexing: Array = field(default_factory=lambda: np.zeros(FLEXING_SIZE))

    @staticmethod
    def of_samples(noise: SensorNoise, samples: int, rate: float, correlation: float = 0.0) -> RowNoise:
        """Return the noise of means over several samples, for robots that are all alike.

        The difference between slope and mean angular acceleration counts as noise of the slope; it matters in long
        rows.

        Args:
            noise: Noise of samples.
            samples: Samples per row.
            rate: Samples per second.
            correlation: Correlation time of the noise [s]; its correlation after ``t`` is ``exp(-t / correlation)``.
        """
        alike = 0.0 if correlation == 0.0 else math.exp(-1.0 / (correlation * rate))

        def deviation(weights: Array) -> float:
            """Standard deviation of a weighted sum of samples whose variance is 1."""
            apart = np.abs(np.subtract.outer(range(len(weights)), range(len(weights))))
            return math.sqrt(weights @ np.power(alike, apart) @ weights)

        mean, line = np.full(samples, 1.0 / samples), _line(samples, rate)
        change = 0.5 * rate * np.array([1.0, 0.0, -1.0])
        of_mean = deviation(mean)
        by_shape = _TIMES * _FAST_TURNING * (2.0 * math.pi * _FASTEST * samples / rate) ** 2 / 60.0
        slope = math.hypot(noise.gyro * deviation(line), by_shape)
        rates = np.full(WRENCH.stop, deviation(np.convolve(mean, change)) / of_mean)
        rates[SLOPE] = deviation(np.convolve(line, change)) * noise.gyro / slope
        means = noise.per_column() * of_mean
        row = np.concatenate([means[_SAMPLES[0]], np.full(3, slope), means[_SAMPLES[1]]])[None]
        slowness = (1.0 + alike) / (1.0 - alike) / samples / of_mean**2
        row *= math.sqrt(slowness)
        flexing = [deviation(each) / of_mean for each in flexing_weights(samples, flexing_margin(rate), rate)]
        return RowNoise(row[:, KINEMATICS], row[:, WRENCH], rates[None], slowness, np.repeat(flexing, 3))

    @staticmethod
    def of_team(
        noises: Sequence[SensorNoise],
        samples: int,
        rate: float,
        correlation: float = 0.0,
        missing: Sequence[Collection[str]] = (),
    ) -> RowNoise:
        """Return the noise of means over several samples, for robots with this noise each; see ``of_samples``.

        ``missing`` names the sensors of ``SENSORS`` that each robot does not have.
        """
        alike = noises[:1] if len(set(noises)) == 1 and not any(missing) else noises
        each = [RowNoise.of_samples(noise, samples, rate, correlation) for noise in alike]
        row = np.concatenate([np.hstack([own.kinematics, own.wrench]) for own in each])
        rates = np.concatenate([own.rates for own in each])
        for robot, without in enumerate(missing):
            for sensor in without:
                for part in _OF_SENSOR[sensor]:
                    row[robot, part] = np.inf
        return replace(each[0], kinematics=row[:, KINEMATICS], wrench=row[:, WRENCH], rates=rates)


def row_of_samples(samples: Array, gyro_variance: float, rate: float) -> Array:
    """Compute the row (24,) of consecutive samples.

    Args:
        samples: In the robot's grasp frame, ``(w, v, a, f, t)``, shape (B, 15), with B of at least 2.
        gyro_variance: Variance of one gyro sample [rad²/s²], which is subtracted from the products.
        rate: Samples per second.
    """
    count = len(samples)
    row = np.empty(ROW_SIZE)
    w, mean = samples[:, W], np.add.reduce(samples, axis=0) / count
    row[:9], row[WRENCH] = mean[_SAMPLES[0]], mean[_SAMPLES[1]]
    row[SLOPE] = _line(count, rate) @ w
    row[PRODUCTS] = (w.T @ w).take(_FLAT_PRODUCTS) / count
    row[18:21] -= gyro_variance
    return row


def row_with_rates(samples: Array, gyro_variance: float, rate: float) -> Array:
    """Compute the row of all samples (B + 2, 15) but the first and the last, and its rates, shape (48,).

    For the arguments, see ``row_of_samples``.
    """
    parts = (samples[:-2], samples[1:-1], samples[2:])
    before, now, after = (row_of_samples(part, gyro_variance, rate) for part in parts)
    return np.concatenate([now, 0.5 * rate * (after - before)])


@cache
def _line(count: int, rate: float) -> Array:
    """Weights (B,) of samples in the slope of their least-squares line."""
    times = np.arange(count, dtype=np.float64) - 0.5 * (count - 1)
    return times * (12.0 * rate / (count * (count**2 - 1)))


def flexing_margin(rate: float) -> int:
    """Samples before and after a row of which forces are used."""
    return max(3, round(_MARGIN * rate))


def flexing(samples: Array, margin: int, rate: float) -> Array:
    """How fast the force changes in a row, in axes that do not turn: ``(u1, u2)``, shape (6,) [N/s, N/s²].

    These are derivatives of a least-squares polynomial of fourth degree through the forces of a row and of some time
    before and after it, turned into the axes of the row's middle by the gyro. A constant of the row's own is fitted
    beside it, so their noise is independent of that of the row's mean force, with which they are multiplied in moments.

    Args:
        samples: Of the row, and ``margin`` more before and after it, shape (B + 2 margin, 15).
        margin: See ``flexing_margin``.
        rate: Samples per second.
    """
    steps = (samples[1:, W] + samples[:-1, W]) / (2.0 * rate)
    turned = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    middle = (len(samples) - 1) // 2
    turned -= 0.5 * (turned[middle] + turned[len(samples) - 1 - middle])
    forces = (rotation_exp(turned) @ samples[:, measurement.FORCE, None])[..., 0]
    result: Array = flexing_weights(len(samples) - 2 * margin, margin, rate) @ forces
    return result.ravel()


@cache
def flexing_weights(row: int, margin: int, rate: float) -> Array:
    """Weights of forces in ``u1`` and in ``u2``, shape (2, row + 2 margin)."""
    count = row + 2 * margin
    half = 0.5 * (count - 1)
    times = np.arange(count) / half - 1.0
    is_own = (np.arange(count) >= margin) & (np.arange(count) < margin + row)
    coefficients = np.linalg.pinv(np.column_stack([np.vander(times, _DEGREE + 1, increasing=True), is_own]))
    result: Array = coefficients[1:3] * np.array([[rate / half], [2.0 * (rate / half) ** 2]])
    return result

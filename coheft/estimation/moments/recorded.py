"""Poses and load from a whole recording at once, with the residual wrench that they leave.

rows of all samples -> moments -> poses by motion alone -> poses and load jointly
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.measurement import SAMPLE_SIZE, SensorNoise
from coheft.estimation.moments.body import FORCING, BodyModel, load_operator, residual_covariance
from coheft.estimation.moments.fit import Estimate, fit_state
from coheft.estimation.moments.fit_settings import FitSettings, Guess
from coheft.estimation.moments.moments import EvaluatedMoments, RowMoments, evaluated_moments
from coheft.estimation.moments.rows import RowNoise, row_of_samples, rows_per_block
from coheft.estimation.moments.start import first_load, poses_by_motion
from coheft.estimation.moments.unknowns import State

_MOST_STEPS, _CLOSE = 30, 1e-3
"""Most steps; a step below this share of the poses' standard deviations is the last one."""
_LEAST = 2
"""Fewest samples of a row."""


@dataclass(frozen=True, eq=False)
class Recorded:
    """Fit of a recording.

    Attributes:
        estimate: Poses and load in the first robot's grasp frame.
        is_settled: Whether the fit has converged.
        row_samples: Samples per row.
        residual: Total wrench of each row less that of the fitted load, shape (rows, 6).
        expected: Covariance of the residual by the sensors' noise, shape (6, 6).
    """

    estimate: Estimate
    is_settled: bool
    row_samples: int
    residual: Array
    expected: Array


def fit_recorded(samples: Array, noise: SensorNoise, rate: float) -> Recorded:
    """Fit poses and load to all samples of all robots, taken while the load was the same.

    Args:
        samples: Consecutive, shape (n, N, 15), columns as in ``MeasurementBlock``: the force comes before the torque,
            unlike in files of recordings; ``coheft.estimators.samples_of`` converts these.
        noise: Noise of every robot's sensors.
        rate: Samples per second.

    Raises:
        ValueError: Shapes do not fit, or there are fewer than two samples.
        numpy.linalg.LinAlgError: Numbers are too large or too small to be computed with.
    """
    if samples.ndim != 3 or samples.shape[2] != SAMPLE_SIZE or len(samples) < _LEAST:
        raise ValueError(f"{samples.shape=} but expected (n, N, {SAMPLE_SIZE}) with n of at least {_LEAST}")
    second = max(_LEAST, round(rate))
    length = min(second // rows_per_block(second, rate), len(samples))
    rows = _rows(samples, length, noise, rate)
    settings = FitSettings(RowNoise.of_samples(noise, length, rate), length / rate)
    moments = RowMoments.of(rows)

    def evaluate(body: BodyModel) -> EvaluatedMoments:
        return evaluated_moments(body, moments, moments)

    count = samples.shape[1]
    state = State.first([Pose.identity()] * count, settings.errors)
    state = poses_by_motion(state, np.arange(count) > 0, moments, evaluate, settings.expected, settings, anchor=0)
    body = settings.body(state)
    guess = Guess.of(body, moments)
    state = first_load(state, evaluate(body).wrench, guess, settings)
    for _ in range(_MOST_STEPS):
        estimate = fit_state(state, evaluate, settings.expected, guess, settings, anchor=0, most_steps=1)
        state = estimate.state
        if estimate.step < _CLOSE:
            break
    body, load = estimate.body, state.fitted_load
    explained = load_operator(load) @ body.motion_map[FORCING]
    return Recorded(
        estimate=estimate,
        is_settled=estimate.step < _CLOSE,
        row_samples=length,
        residual=rows @ (body.wrench_map - explained).T,
        expected=residual_covariance(body, load),
    )


def _rows(samples: Array, length: int, noise: SensorNoise, rate: float) -> Array:
    """Rows of the whole team with the constant 1, shape (rows, 24 N + 1); left-over samples are ignored."""
    count = len(samples) // length
    rows = np.array(
        [
            np.concatenate([row_of_samples(own, noise.gyro**2, rate) for own in part.swapaxes(0, 1)])
            for part in samples[: count * length].reshape(count, length, *samples.shape[1:])
        ]
    )
    return np.hstack([rows, np.ones((count, 1))])

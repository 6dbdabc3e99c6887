"""Drifting offsets move scores as far as drawn random walks do."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.estimation.moments.chapter import EvidenceAt
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.likelihood import Derivatives
from coheft.estimation.moments.moments import RowMoments, evaluated_moments
from coheft.estimation.moments.pose_steps import ScoreDrift
from coheft.estimation.moments.rows import ROW_SIZE, WRENCH, A, W
from coheft.estimation.tolerance import SensorDrift
from tests.estimation.moments.fitting import buffer_of
from tests.estimation.moments.moving_team import NOISE, PERIOD, make_team

COUNT, ROBOT, NUMBER = 6, 2, 60


@pytest.mark.parametrize("first", [0, 30, 50])
@pytest.mark.parametrize(
    ("columns", "drift"),
    [(W, SensorDrift(gyro=1.0)), (A, SensorDrift(acceleration=1.0)), (WRENCH, SensorDrift(force=1.0, torque=1.0))],
    ids=["gyro", "accelerometer", "wrench"],
)
def test_the_covariance_is_that_of_drawn_random_walks(columns: slice, drift: SensorDrift, first: int) -> None:
    """Only this robot's motion sensors drift; of wrenches, those of all, because only their total is compared."""
    settings, team = FitSettings(NOISE, PERIOD, drift=drift), make_team(3, count=COUNT, number=NUMBER)
    body, rng = settings.body(team.state()), np.random.default_rng(5)
    at_state, pose = EvidenceAt(Derivatives(body)), body.unknowns.poses[ROBOT]
    robots = range(COUNT) if columns is WRENCH else [ROBOT]
    scores = []
    for _ in range(300):
        rows = team.rows.copy()
        for robot in robots:
            steps = rng.normal(size=(NUMBER, columns.stop - columns.start)) * np.sqrt(PERIOD / 60.0)
            walk = np.cumsum(steps, axis=0)
            rows[:, ROW_SIZE * robot + columns.start : ROW_SIZE * robot + columns.stop] += walk - walk.mean(axis=0)
        moments = RowMoments.of(rows[first:])
        scores.append(at_state.of(evaluated_moments(body, moments, moments)).score[pose])
    drawn = np.cov(np.array(scores).T)
    expected = ScoreDrift(body, buffer_of(team.rows, settings, COUNT), settings).covariances(first)[ROBOT]
    ratios = np.linalg.eigvals(np.linalg.lstsq(expected, drawn, rcond=1e-6)[0]).real
    # The fused motion follows a robot's own sensors; a gyro's mean over the newest rows counts for nothing at all.
    least = {W.start: 0.0, A.start: 0.2, WRENCH.start: 0.7}[columns.start]
    assert (ratios < 1.4).all()
    assert (ratios[ratios > 1e-3] > least).all()


def test_wrenches_of_an_earlier_load_have_no_part() -> None:
    settings, team = FitSettings(NOISE, PERIOD, drift=SensorDrift(force=1.0)), make_team(3, number=NUMBER)
    body, buffer = settings.body(team.state()), buffer_of(team.rows, settings, 3)
    every = ScoreDrift(body, buffer, settings).covariances(40)[ROBOT]
    buffer.begin_load(NUMBER - 1)
    assert np.trace(ScoreDrift(body, buffer, settings).covariances(40)[ROBOT]) < 0.1 * np.trace(every)


def test_sensors_drift_while_rows_are_missing() -> None:
    settings, team = FitSettings(NOISE, PERIOD, drift=SensorDrift(acceleration=0.1)), make_team(3, number=NUMBER)
    body, buffer = settings.body(team.state()), buffer_of(team.rows, settings, 3)
    all_rows = ScoreDrift(body, buffer, settings).covariances(40)[ROBOT]
    buffer.numbers[:NUMBER] = 2 * np.arange(NUMBER)
    every_other_row = ScoreDrift(body, buffer, settings).covariances(40)[ROBOT]
    np.testing.assert_allclose(every_other_row, 2.0 * all_rows, rtol=1e-9, atol=1e-9 * np.abs(all_rows).max())

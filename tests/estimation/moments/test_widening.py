"""Tolerances that the found errors contradict."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.sensor_errors import SensorErrors
from coheft.estimation.moments.widening import widened
from tests.estimation.moments.fitting import Fitted, fit
from tests.estimation.moments.moving_team import NOISE, PERIOD, extended_for, make_team, misread, noisy_for, with_errors

DECLARED = {"acceleration_scale": 0.002, "gyro_mounting": 0.003}
SETTINGS = FitSettings(NOISE, PERIOD, SensorErrors(DECLARED))


def fitted(scale: float, settings: FitSettings = SETTINGS, mounting: float = 1.0) -> Fitted:
    """A fit to rows of a team whose scales and mountings are so many times as large as declared."""
    rng, team = np.random.default_rng(4), make_team(4, count=6, number=600)
    team = team.expressed_in(team.poses[0])
    true = SensorErrors(
        {
            "acceleration_scale": scale * DECLARED["acceleration_scale"],
            "gyro_mounting": mounting * DECLARED["gyro_mounting"],
        }
    )
    state, _ = with_errors(team, true, rng, gyros=0.0)
    return fit(misread(noisy_for(true, team, rng), state), settings)


def factors(found: FitSettings) -> dict[str, float]:
    return {kind: found.errors.tolerances[0][kind] / size for kind, size in DECLARED.items()}


def test_the_tolerance_of_the_kind_that_is_larger_grows() -> None:
    found = widened(fitted(3.0).estimate, SETTINGS, SETTINGS)
    assert found is not None
    assert 2.0 < factors(found)["acceleration_scale"] < 4.0
    assert 1.0 <= factors(found)["gyro_mounting"] < 1.5
    assert found.errors.names == SETTINGS.errors.names


def test_no_tolerance_shrinks_and_none_grows_beyond_a_limit() -> None:
    found = widened(fitted(30.0).estimate, SETTINGS, SETTINGS)
    assert found is not None
    assert factors(found)["acceleration_scale"] == pytest.approx(4.0)
    again = widened(fitted(0.01, found, mounting=3.0).estimate, found, SETTINGS)
    assert again is not None
    assert factors(again)["acceleration_scale"] == pytest.approx(4.0)
    assert factors(again)["gyro_mounting"] > 1.5
    wide = SensorErrors({kind: 4.0 * size for kind, size in DECLARED.items()})
    widest = FitSettings(NOISE, PERIOD, wide)
    assert widened(fitted(30.0, widest).estimate, widest, SETTINGS) is None


def test_offsets_of_the_team_count_as_well() -> None:
    settings = FitSettings(NOISE, PERIOD, SensorErrors(DECLARED), force_offset=0.01, torque_offset=0.1)
    rng, team = np.random.default_rng(5), make_team(5, count=4, number=600)
    team = team.expressed_in(team.poses[0])
    rows = extended_for(settings.errors, team.noisy(rng))
    rows = rows + np.append(np.tile(np.r_[np.zeros(12), 0.04, -0.04, 0.04, np.zeros(9)], 4), 0.0)
    found = widened(fit(rows, settings).estimate, settings, settings)
    assert found is not None
    assert 2.0 < float(found.force_offset) / 0.01 <= 4.0
    assert float(found.torque_offset) / 0.1 < 1.5

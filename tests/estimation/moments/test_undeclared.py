"""Errors of sensors that were not told: rows ask for the right one, and for none that is not there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.rows import FORCE, ROW_SIZE
from coheft.estimation.moments.sensor_errors import SensorErrors
from coheft.estimation.moments.undeclared import KINDS_OF_ONE_ROBOT, UndeclaredError, undeclared_error
from coheft.estimation.moments.unknowns import Unknowns
from tests.estimation.moments.fitting import IDEAL, fit
from tests.estimation.moments.moving_team import NOISE, PERIOD, make_team, misread, noisy_for

SIZES = {
    "acceleration_bias": 0.05,
    "gyro_mounting": 0.01,
    "velocity_mounting": 0.03,
    "acceleration_mounting": 0.01,
    "gyro_scale": 0.02,
    "velocity_scale": 0.05,
    "acceleration_scale": 0.01,
    "force_scale": 0.02,
    "torque_scale": 0.2,
    "velocity_place": 0.02,
    "acceleration_place": 0.03,
}


def asked_for(
    seed: int, kind: str | None, settings: FitSettings = IDEAL, false_alarm: float = 1e-9, delay: float = 0.0
) -> UndeclaredError | None:
    """Of a team of which the second robot has an error of a kind, and of which the clock of the third is off [s]."""
    rng, team = np.random.default_rng(seed), make_team(seed, count=4, number=400)
    team = team.expressed_in(team.poses[0])
    rows = noisy_for(settings.errors, team, rng)
    if kind is not None:
        errors = SensorErrors({kind: SIZES[kind]} | settings.errors.tolerances[0])
        state, unknowns = team.state(errors), Unknowns(4, errors)
        step = np.zeros(unknowns.size)
        is_kind = [name == kind for name in errors.names]
        step[unknowns.eta[1, is_kind]] = SIZES[kind] * np.array([1.0, -1.0, 1.0])
        step[unknowns.eta[2, [name == "clock" for name in errors.names]]] = delay
        rows = misread(rows, state.moved(step, unknowns, 6.0))
    found = fit(rows, settings)
    return undeclared_error(found.estimate, found.chapter, settings, 0, KINDS_OF_ONE_ROBOT, false_alarm)


@pytest.mark.parametrize("kind", SIZES)
def test_rows_ask_for_the_error_that_is_there(kind: str) -> None:
    found = asked_for(3, kind)
    assert found is not None
    assert (found.robot, found.kind) == (1, kind)
    assert found.size > 1.0


@pytest.mark.parametrize("seed", range(4))
def test_rows_of_exact_sensors_ask_for_none(seed: int) -> None:
    found = asked_for(seed, None, false_alarm=1e-4)
    assert found is not None
    assert found.size < 1.0


def test_what_was_told_is_not_asked_for_but_the_rest_is() -> None:
    told = FitSettings(NOISE, PERIOD, SensorErrors({"gyro_mounting": 0.01, "clock": 0.001}))
    found = asked_for(5, None, told)
    assert found is not None
    assert found.size < 1.0
    found = asked_for(5, "acceleration_scale", told)
    assert found is not None
    assert (found.robot, found.kind) == (1, "acceleration_scale")
    found = asked_for(5, "gyro_mounting", told)
    assert found is not None
    assert found.size < 1.0


def test_while_much_is_in_doubt_nothing_is_asked_for() -> None:
    noise = replace(NOISE, kinematics=10.0 * NOISE.kinematics, wrench=10.0 * NOISE.wrench)
    errors = SensorErrors({"clock": 0.001, "wrench_delay": 0.001, "grasp_compliance": 2e-5})
    settings, team = FitSettings(noise, PERIOD, errors), make_team(1, count=3, number=30)
    team = team.expressed_in(team.poses[0])
    found = fit(noisy_for(errors, team, np.random.default_rng(1), noise), settings)
    assert not found.estimate.misses_poses
    assert undeclared_error(found.estimate, found.chapter, settings, 0, KINDS_OF_ONE_ROBOT, 1e-9) is None


def test_offsets_of_forces_are_found_where_nothing_else_is_tested() -> None:
    team = make_team(4, count=4, number=400)
    rows = noisy_for(IDEAL.errors, team.expressed_in(team.poses[0]), np.random.default_rng(4))
    rows[:, ROW_SIZE + FORCE.start] += 2.0
    found = fit(rows, IDEAL)
    error = undeclared_error(found.estimate, found.chapter, IDEAL, 0, (), 1e-9)
    assert error is not None
    assert (error.robot, error.kind) == (1, "force_bias")
    assert error.size > 1.0


@pytest.mark.parametrize(("delay", "is_tested"), [(0.001, True), (0.004, False)])
def test_sensors_that_are_late_may_seem_to_have_other_errors(delay: float, is_tested: bool) -> None:
    """What the square of the delay does to readings is not in the rows."""
    clocks = FitSettings(NOISE, PERIOD, SensorErrors({"clock": 0.004}))
    found = asked_for(5, "gyro_scale", clocks, delay=delay)
    assert found is not None
    assert (found.kind == "gyro_scale") == is_tested

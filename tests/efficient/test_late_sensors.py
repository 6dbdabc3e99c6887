"""Delays that no tolerance allows for: the right robot is named, though rows carry no rates."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.agents.efficient.innovations import Innovations
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.sensor_errors import DELAYS, SensorErrors
from coheft.estimation.moments.undeclared import UndeclaredError
from coheft.estimation.moments.unknowns import Unknowns
from tests.estimation.moments.fitting import IDEAL, fit
from tests.estimation.moments.moving_team import NOISE, PERIOD, extended_for, make_team, misread, noisy_for


def latest(
    seed: int,
    kind: str | None,
    settings: FitSettings = IDEAL,
    false_alarm: float = 1e-9,
    in_groups_of: int = 400,
    count: int = 4,
) -> UndeclaredError | None:
    """Of a team of which the sensors of the last robot but one are 2 ms late, after a fit to 400 rows; some are missing
    between groups.
    """
    rng, team = np.random.default_rng(seed), make_team(seed, count=count, number=402)
    team = team.expressed_in(team.poses[0])
    late = SensorErrors({kind or "clock": 0.002})
    state, unknowns = team.state(late), Unknowns(count, late)
    step = np.zeros(unknowns.size)
    step[unknowns.eta[-2]] = 0.002 if kind else 0.0
    extended = extended_for(late, team.rows)
    delayed = misread(extended, state.moved(step, unknowns, 6.0)) - extended
    rows = noisy_for(settings.errors, team, rng)
    if not settings.errors.has_rates:
        rows = rows[1:-1]
    rows[:, : delayed.shape[1] // 2] += delayed[:, : delayed.shape[1] // 2]
    found = fit(rows, settings)
    buffer = found.chapter.buffer
    buffer.numbers += 10 * (np.arange(len(buffer.numbers)) // in_groups_of)
    return Innovations(found.estimate, found.chapter).late_sensor(PERIOD, false_alarm)


@pytest.mark.parametrize("kind", DELAYS)
def test_late_sensors_are_named(kind: str) -> None:
    found = latest(3, kind)
    assert found is not None
    assert (found.robot, found.kind) == (2, kind)
    assert found.size > 1.0


@pytest.mark.parametrize("seed", range(4))
def test_sensors_in_time_are_not_named(seed: int) -> None:
    found = latest(seed, None, false_alarm=1e-3)
    assert found is not None
    assert found.size < 1.0


def test_a_delay_that_is_declared_is_not_tested() -> None:
    only_clocks = FitSettings(NOISE, PERIOD, SensorErrors({"clock": 0.001}))
    found = latest(3, "clock", only_clocks)
    assert found is not None
    assert found.kind == "wrench_delay"
    assert found.size < 1.0
    assert latest(3, "clock", FitSettings(NOISE, PERIOD, SensorErrors(dict.fromkeys(DELAYS, 0.001)))) is None


def test_changes_over_missing_rows_do_not_count() -> None:
    assert latest(3, "clock", in_groups_of=2) is None


def test_rows_with_rates_are_compared_with_those_beside_their_neighbours() -> None:
    """The rates of a row are from samples of its neighbours, whose noise they share."""
    only_clocks = FitSettings(NOISE, PERIOD, SensorErrors({"clock": 0.001}))
    assert latest(3, None, only_clocks) is not None
    assert latest(3, None, only_clocks, in_groups_of=3) is None
    assert latest(3, None, in_groups_of=3) is not None


def test_of_two_clocks_none_is_named() -> None:
    found = latest(3, "clock", count=2)
    assert found is not None
    assert (found.robot, found.kind) == (None, "clock")
    assert found.size > 1.0

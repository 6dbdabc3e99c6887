"""A change of the load among the rows of one fit: what it makes wrong, and where it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coheft.estimation.chi_square import chi_square_threshold
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.change import windows
from coheft.estimation.moments.change_at_fit import Shown, change_within_fit, error_by_step
from coheft.estimation.moments.derivatives import MotionDerivatives, WrenchDerivatives
from coheft.estimation.moments.evidence import Evidence
from coheft.estimation.moments.likelihood import wrench_evidence
from coheft.estimation.moments.moments import RowMoments, wrench_moments
from coheft.estimation.moments.rows import RowNoise
from coheft.estimation.moments.sensor_errors import SensorErrors
from coheft.estimation.moments.unknowns import THETA
from tests.estimation.moments.fitting import IDEAL, Fitted, erring, fit
from tests.estimation.moments.moving_team import NOISE, make_team

QUIET = replace(IDEAL, noise=RowNoise(1e-4 * NOISE.kinematics, 1e-4 * NOISE.wrench))


def wrenches(found: Fitted, rows: Array) -> Evidence:
    body = found.estimate.body
    assert body.state.load is not None
    moments = wrench_moments(body, RowMoments.of(rows))
    return wrench_evidence(body, WrenchDerivatives.at(body, MotionDerivatives.at(body)), moments)


def statistic(found: Fitted, rows: Array) -> float:
    estimate = found.estimate
    newest = Shown.of(wrenches(found, rows), estimate.body.unknowns.theta)
    return float(change_within_fit(newest, estimate.inverse))


@pytest.mark.parametrize("newest", [10, 40])
def test_a_step_that_a_fit_does_not_allow_for_makes_poses_and_load_wrong(newest: int) -> None:
    team, first = make_team(seed=2, number=100), 100 - newest
    step = np.repeat([0.0, 0.002], [6, 10]) * team.expressed_in(team.poses[0]).load
    changed = team.holding(team.load * np.repeat([1.0, 1.002], [6, 10]), slice(first, None))
    rows = changed.noisy(np.random.default_rng(3), QUIET.noise)
    found, theta = fit(rows, QUIET), IDEAL.body(team.state()).unknowns.theta
    derivative = error_by_step(wrenches(found, rows[first:]).information[:, theta], found.estimate.inverse, theta)
    now = team.holding(team.load * np.repeat([1.0, 1.002], [6, 10]))
    error, expected = -found.error(now), derivative @ step[THETA]
    deviations = np.sqrt(np.maximum(found.estimate.seen.diagonal(), 1e-30))
    is_wrong = np.abs(expected) > 20.0 * deviations
    assert is_wrong[found.estimate.body.unknowns.poses].any()
    assert is_wrong[theta].any()
    np.testing.assert_allclose(error[is_wrong], expected[is_wrong], rtol=0.1)


def test_without_a_change_the_statistic_is_chi_square() -> None:
    found = []
    for seed in range(60):
        rows = make_team(seed, number=90).noisy(np.random.default_rng(seed + 7))
        found.append(statistic(fit(rows), rows[60:]))
    assert 8.0 < np.mean(found) < 12.5
    assert max(found) < chi_square_threshold(10, 1e-5)


def test_rows_that_do_not_show_the_load_show_no_change_of_it() -> None:
    nothing = Evidence(np.ones(16), np.zeros((16, 16)), np.eye(16), np.eye(16))
    assert change_within_fit(Shown.of(nothing, slice(6, 16)), np.eye(16)) == 0.0


def test_groups_are_tested_as_each_alone_would_be_even_if_some_are_not_seen() -> None:
    rng = np.random.default_rng(1)
    roots = rng.normal(size=(3, 6, 20))
    information, noise = roots @ roots.swapaxes(1, 2), 0.01 * np.broadcast_to(np.eye(6), (3, 6, 6))
    unseen = information.copy()
    unseen[1, 5] = unseen[1, :, 5] = 0.0
    inverse, drift = 1e-3 * np.eye(6), 0.5 * np.broadcast_to(np.eye(6), (3, 6, 6))
    for each in (information, unseen):
        shown = Shown(rng.normal(size=(3, 6)), each, each + noise, noise)
        found = change_within_fit(shown, inverse, drift)
        alone = [float(change_within_fit(Shown(*one), inverse, drift[0])) for one in zip(*shown, strict=True)]
        np.testing.assert_allclose(found, alone, rtol=1e-12)
        assert (found > 0.0).all()
    without = rng.normal(size=5)
    less = Shown(np.append(without, 0.0), *(each[1] for each in (unseen, unseen + noise, noise)))
    seen = Shown(without, unseen[1, :5], *(each[1, :5, :5] for each in (unseen + noise, noise)))
    expected = float(change_within_fit(seen, inverse))
    np.testing.assert_allclose(float(change_within_fit(less, inverse)), expected, rtol=1e-12)


def test_windows_grow_and_are_shorter_than_all_rows() -> None:
    assert windows(1).tolist() == []
    for count in (2, 30, 1000):
        found = windows(count)
        assert found[0] == 1
        assert found[-1] < count <= np.ceil(1.55 * (found[-1] + 1))
        assert (np.diff(found) > 0).all()


@pytest.mark.parametrize("tolerance", [0.0, 0.01])
def test_a_change_is_located_with_poses_and_errors_of_sensors_from_the_rows_of_both_loads(tolerance: float) -> None:
    kinds = ("force_scale", "torque_scale", "acceleration_mounting")
    errors = SensorErrors(dict.fromkeys(kinds, tolerance))
    settings = replace(IDEAL, errors=errors, force_offset=100.0 * tolerance, torque_offset=5.0 * tolerance)
    found = []
    for seed in range(8):
        team = make_team(seed, number=90)
        changed = team.holding(team.load * np.repeat([1.0, 1.005], [6, 10]), slice(60, None))
        rows = erring(changed, settings, np.random.default_rng(seed))[1]
        fitted = fit(rows, settings)
        found.append(max(windows(90).tolist(), key=lambda window: statistic(fitted, rows[90 - window :])))
    assert set(found) <= {26, 38}, "those next to 30"

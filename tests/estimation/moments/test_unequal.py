"""Robots whose noise or tolerances differ: each counts by its own, and what is exact stays zero."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coheft.estimation.measurement import SensorNoise
from coheft.estimation.moments.claims import found_errors
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.rows import RowNoise
from coheft.estimation.moments.sensor_errors import SensorErrors
from coheft.estimation.moments.undeclared import KINDS_OF_ONE_ROBOT, undeclared_error
from coheft.estimation.moments.unknowns import Unknowns
from coheft.estimation.tolerance import SensorDrift, SensorTolerance
from tests.estimation.moments.fitting import IDEAL, erring, fit, normalised_error
from tests.estimation.moments.moving_team import NOISE, PERIOD, body_at, make_team, misread, noisy_for

GAIN, MIXED = {"force_gain": 0.01}, {"force_gain": 0.03, "acceleration_bias": 0.05}
UNEQUAL = SensorErrors(GAIN, MIXED, {}, GAIN)
SETTINGS = FitSettings(NOISE, PERIOD, UNEQUAL)


def noise_of(*factors: float) -> RowNoise:
    return RowNoise.of_team([SensorNoise().scaled(factor) for factor in factors], 10, 500.0, 0.01)


def test_noise_of_a_team_is_that_of_each_robot_and_of_equal_ones_that_of_one() -> None:
    one, team, alike = noise_of(1.0), noise_of(1.0, 5.0, 2.0), noise_of(1.0, 1.0)
    np.testing.assert_allclose(team.wrench / one.wrench, np.repeat([[1.0], [5.0], [2.0]], 6, axis=1))
    assert team.rates.shape == (3, 18)
    assert team.slowness == one.slowness
    np.testing.assert_array_equal(alike.kinematics, one.kinematics)
    np.testing.assert_array_equal(alike.rates, one.rates)


def test_all_robots_have_the_parameters_that_any_of_them_declares() -> None:
    assert UNEQUAL.names == ("acceleration_bias",) * 3 + ("force_gain",)
    np.testing.assert_array_equal(UNEQUAL.deviations[:, [0, 3]], [[0, 0.01], [0.05, 0.03], [0, 0], [0, 0.01]])
    alike = SensorErrors.of([SensorTolerance(clock=1.0)] * 3, SensorDrift(), [SensorTolerance(gyro_scale=0.1)])
    assert alike.names == ("gyro_scale",) * 3 + ("clock",)
    np.testing.assert_array_equal(alike.deviations, [[0.0, 0.0, 0.0, 2.0**0.5]])


def test_what_is_exact_is_neither_free_nor_found() -> None:
    unknowns = Unknowns(4, UNEQUAL)
    free = SETTINGS.free(unknowns, 0, with_load=True)
    np.testing.assert_array_equal(np.isin(unknowns.eta, free), unknowns.deviations > 0.0)
    _, rows = erring(make_team(seed=1, count=4, number=150), SETTINGS, np.random.default_rng(2))
    found = fit(rows, SETTINGS).estimate
    assert not found.state.eta[unknowns.deviations == 0.0].any()
    assert [[error.key for error in found_errors(found, robot, SETTINGS.errors)] for robot in range(4)] == [
        ["force_gain"],
        ["acceleration_offset"] * 3 + ["force_gain"],
        [],
        ["force_gain"],
    ]


def test_fits_are_as_sure_as_they_may_be() -> None:
    found = []
    for seed in range(12):
        truth, rows = erring(make_team(seed=seed, count=4, number=150), SETTINGS, np.random.default_rng(seed + 100))
        estimate = fit(rows, SETTINGS).estimate
        found.append(normalised_error(truth.since(estimate.state, estimate.body.unknowns), estimate, SETTINGS))
    assert 0.75 < np.mean(found) < 1.3


def test_a_noisy_robot_makes_the_motion_of_the_team_no_less_certain() -> None:
    team = make_team(seed=4, count=4)
    noisy, fewer = noise_of(1.0, 1.0, 1.0, 5.0), noise_of(1.0, 1.0, 1.0)
    of_four = body_at(team.state(), noise=noisy).motion_noise
    of_three = body_at(team.permuted([0, 1, 2]).state(), noise=fewer).motion_noise
    assert np.linalg.eigvalsh(of_three - of_four)[0] > -1e-12
    # Weighed like the others it would.
    equal = body_at(team.state(), noise=noise_of(1.0))
    by_robot = np.square(noisy.kinematics[:, None, :6]) * np.square(equal.twist.gain) / noisy.slowness
    assert (by_robot.sum(axis=(0, 2)) > of_three.diagonal()[1:7]).all()


def test_a_sensor_that_is_told_to_be_exact_is_tested_although_others_are_not() -> None:
    declared = {"gyro_mounting": 0.02}
    settings = FitSettings(NOISE, PERIOD, SensorErrors(declared, {}, declared, declared))
    team = make_team(5, count=4, number=400)
    team = team.expressed_in(team.poses[0])
    rows = noisy_for(settings.errors, team, np.random.default_rng(5))
    for robot, is_found in ((1, True), (2, False)):
        state, unknowns = team.state(settings.errors), Unknowns(4, SensorErrors(declared))
        step = np.zeros(unknowns.size)
        step[unknowns.eta[robot]] = [0.02, -0.02, 0.02]
        found = fit(misread(rows, state.moved(step, unknowns, 6.0)), settings)
        error = undeclared_error(found.estimate, found.chapter, settings, 0, KINDS_OF_ONE_ROBOT, 1e-9)
        assert (error is not None and (error.robot, error.kind) == (1, "gyro_mounting")) == is_found


@pytest.mark.parametrize("members", [[0, 1, 3], [0, 2, 1], [0, 3]])
def test_robots_that_leave_are_eliminated_with_what_each_of_them_declares(members: list[int]) -> None:
    everyone = make_team(seed=6, count=4, number=200)
    _, rows = erring(everyone, SETTINGS, np.random.default_rng(7))
    former = fit(rows, SETTINGS)
    errors = SensorErrors(*(UNEQUAL.tolerances[robot] for robot in members), other_kinds=MIXED)
    settings = replace(SETTINGS, errors=errors)
    prior = former.chapter.posterior(former.estimate, former.chapter.evaluation())
    fewer = prior.for_team(members, SETTINGS, settings)
    covariances = []
    for each, own, robots in ((prior, SETTINGS, members), (fewer, settings, list(range(len(members))))):
        body = own.body(each.state)
        total, unknowns = each.evidence + own.expected(body), body.unknowns
        free = own.free(unknowns, 0, with_load=True)
        covariance = np.zeros((unknowns.size, unknowns.size))
        covariance[np.ix_(free, free)] = np.linalg.inv(total.restricted(free).information)
        kept = np.concatenate(
            [*(unknowns.of_robot(robot) for robot in robots), np.arange(unknowns.size)[unknowns.theta]]
        )
        covariances.append(covariance[np.ix_(kept, kept)])
    before, after = covariances
    scale = np.maximum(np.sqrt(before.diagonal()), 1e-9)
    np.testing.assert_allclose(after / np.outer(scale, scale), before / np.outer(scale, scale), atol=1e-4)
    np.testing.assert_array_equal(fewer.state.eta, former.estimate.state.eta[members])


def test_offsets_of_each_robot_add_up() -> None:
    team = make_team(seed=8, count=3)
    each = [replace(IDEAL, force_offset=float(size), torque_offset=0.1) for size in (1.0, 2.0, 3.0)]
    unequal = replace(IDEAL, force_offset=np.array([1.0, 2.0, 3.0]), torque_offset=np.full(3, 0.1))
    body = body_at(team.state())
    force = unequal.offset_covariance(body)[:3, :3]
    np.testing.assert_allclose(force, (1.0 + 4.0 + 9.0) * np.eye(3), atol=1e-9)
    np.testing.assert_allclose(each[1].offset_covariance(body)[:3, :3], 12.0 * np.eye(3), atol=1e-9)
    guess = fit(team.noisy(np.random.default_rng(9))).estimate.guess
    of_two = unequal.offset_variances([0, 2], guess)
    np.testing.assert_allclose(of_two[:3], 10.0)
    np.testing.assert_allclose(each[1].offset_variances([0, 2], guess)[:3], 8.0)
    assert not unequal.offset_variances([], guess).any()


def test_a_clock_that_is_exact_differs_from_one_that_is_not() -> None:
    """Clocks count from the anchor's, which may be any robot's."""
    errors = SensorErrors({"clock": 3e-3}, {}, {"clock": 4e-3})
    np.testing.assert_allclose(errors.deviations[:, 0], [5e-3, 4e-3, 4e-3 * 2**0.5])

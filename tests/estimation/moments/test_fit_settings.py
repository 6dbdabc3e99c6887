"""What a fit takes for granted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.fit_settings import POSE_LIMITS, FitSettings, Guess
from coheft.estimation.moments.moments import RowMoments
from coheft.estimation.moments.sensor_errors import SensorErrors
from coheft.estimation.moments.unknowns import Unknowns
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.estimation.rigid_body.unobservable import middle_and_size
from tests.estimation.moments.fitting import IDEAL
from tests.estimation.moments.moving_team import ERRORS, LATE, NOISE, PERIOD, make_team

WITH_OFFSETS = replace(IDEAL, force_offset=2.0, torque_offset=0.1, gyro_offset=0.01)


def random_step(unknowns: Unknowns, settings: FitSettings, seed: int) -> Array:
    rng, step = np.random.default_rng(seed), np.zeros(unknowns.size)
    step[unknowns.eta] = settings.errors.deviations * rng.normal(size=unknowns.eta.shape)
    step[unknowns.gyros], step[unknowns.offset] = 0.01 * rng.normal(size=3), rng.normal(size=6)
    return step


def test_a_load_at_rest_is_guessed_by_its_weight() -> None:
    team = make_team(seed=1, turning=0.0, moving=0.0)
    guess = Guess.of(IDEAL.body(team.state()), RowMoments.of(team.rows))
    middle, size = middle_and_size(team.poses)
    assert guess.size == size
    assert guess.theta[0] == pytest.approx(team.load[6], rel=1e-9)
    inertia = Inertia.from_barycentric(guess.theta)
    np.testing.assert_allclose(inertia.com, middle, atol=1e-9)
    assert (np.linalg.eigvalsh(inertia.pseudo_inertia()) > 0.0).all()
    np.testing.assert_allclose(guess.limits[:4], guess.theta[0] * np.array([1.0, size, size, size]))
    np.testing.assert_allclose(guess.limits[4:], guess.theta[0] * size**2)


def test_a_moving_load_is_guessed_roughly() -> None:
    for seed in range(5):
        team = make_team(seed)
        guess = Guess.of(IDEAL.body(team.state()), RowMoments.of(team.rows))
        assert (np.abs(guess.theta - team.load[6:]) < guess.limits).all()


def test_nothing_at_all_is_still_a_body() -> None:
    team = make_team(seed=2)
    rows = np.zeros_like(team.rows)
    rows[:, -1] = 1.0
    guess = Guess.of(IDEAL.body(team.state()), RowMoments.of(rows))
    assert 0.0 < guess.theta[0] < 0.01
    assert (guess.limits > 0.0).all()


@pytest.mark.parametrize("settings", [IDEAL, WITH_OFFSETS, FitSettings(NOISE, PERIOD, LATE, 1.0)])
def test_a_fit_moves_what_is_declared_and_not_the_anchor(settings: FitSettings) -> None:
    unknowns = Unknowns(3, settings.errors)
    for anchor in range(3):
        held = set(range(unknowns.size)) - set(settings.free(unknowns, anchor, True).tolist())
        expected = set(unknowns.poses[anchor].tolist())
        if settings.errors is LATE:
            expected.add(int(unknowns.eta[anchor, LATE.names.index("clock")]))
        if not settings.has_offset:
            expected |= set(range(unknowns.size)[unknowns.offset])
        if settings.gyro_offset == 0.0:
            expected |= set(range(unknowns.size)[unknowns.gyros])
        assert held == expected
        poses = set(np.delete(unknowns.poses, anchor, axis=0).ravel().tolist())
        assert set(settings.free(unknowns, anchor, False).tolist()) == poses


def test_offsets_are_declared_by_either_sensor() -> None:
    assert not IDEAL.has_offset
    assert replace(IDEAL, force_offset=1.0).has_offset
    assert replace(IDEAL, torque_offset=1.0).has_offset
    assert not replace(IDEAL, gyro_offset=1.0).has_offset


def test_offsets_of_all_robots_add_up_in_the_body_frame() -> None:
    team, rng = make_team(seed=3, count=4), np.random.default_rng(4)
    body = WITH_OFFSETS.body(team.state())
    own = rng.normal(size=(20_000, 4, 6)) * np.repeat([2.0, 0.1], 3)
    total = np.einsum("nij,tnj->ti", body.adjoints, own)
    found = np.linalg.solve(WITH_OFFSETS.offset_covariance(body), np.cov(total.T))
    np.testing.assert_allclose(found, np.eye(6), atol=0.06)


@pytest.mark.parametrize("errors", [SensorErrors({}), ERRORS, LATE], ids=["exact", "errors", "late"])
def test_what_is_expected_pulls_back_to_exact_sensors(errors: SensorErrors) -> None:
    settings = replace(WITH_OFFSETS, errors=errors)
    team, unknowns = make_team(seed=5), Unknowns(3, errors)
    step = random_step(unknowns, settings, 6)
    body = settings.body(team.state(errors).moved(step, unknowns, 1e9))
    expected = settings.expected(body)
    known = np.concatenate([unknowns.eta.ravel(), np.arange(unknowns.gyros.start, unknowns.theta.start)])
    part = expected.restricted(known)
    np.testing.assert_allclose(np.linalg.solve(part.information, part.score), -step[known], rtol=1e-9)
    covariance = np.linalg.inv(part.information)
    deviations = np.concatenate([np.tile(errors.deviations[0], 3), np.full(3, 0.01 / np.sqrt(3.0))])
    np.testing.assert_allclose(np.sqrt(covariance.diagonal()[:-6]), deviations)
    np.testing.assert_allclose(covariance[-6:, -6:], settings.offset_covariance(body), rtol=1e-9, atol=1e-15)
    others = np.setdiff1d(np.arange(unknowns.size), known)
    assert not expected.information[others].any()
    assert not expected.score[others].any()
    assert not expected.noise.any()


def test_offsets_that_are_not_declared_are_zero() -> None:
    team = make_team(seed=7)
    body = IDEAL.body(team.state())
    known = np.r_[body.unknowns.gyros, body.unknowns.offset]
    covariance = np.linalg.inv(IDEAL.expected(body).restricted(known).information)
    assert np.sqrt(covariance.diagonal()).max() < 1e-8


def test_limits_are_wider_than_what_is_expected() -> None:
    settings = replace(WITH_OFFSETS, errors=ERRORS)
    team = make_team(seed=8)
    body = settings.body(team.state(ERRORS))
    unknowns, guess = body.unknowns, Guess.of(body, RowMoments.of(team.rows))
    limits = settings.limits(3, guess)
    assert limits.shape == (unknowns.size,)
    np.testing.assert_array_equal(limits[unknowns.poses], np.tile(POSE_LIMITS, (3, 1)))
    np.testing.assert_array_equal(limits[unknowns.theta], guess.limits)
    assert (limits[unknowns.eta] > ERRORS.deviations).all()
    assert (limits[unknowns.gyros] > 0.01 / np.sqrt(3.0)).all()
    assert (limits[unknowns.offset] > np.sqrt(settings.offset_covariance(body).diagonal())).all()

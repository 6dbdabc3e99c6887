"""What moments say of all unknowns, against least squares over rows with every motion among the unknowns."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp
from coheft.estimation.moments.body import FORCING, BodyModel, residual_covariance
from coheft.estimation.moments.derivatives import WrenchDerivatives
from coheft.estimation.moments.evidence import Evidence
from coheft.estimation.moments.likelihood import (
    Derivatives,
    MotionFactors,
    information_on_theta,
    information_table,
    motion_evidence,
    wrench_evidence,
)
from coheft.estimation.moments.moments import RowMoments, evaluated_moments, wrench_moments
from coheft.estimation.moments.sensor_errors import SensorErrors
from coheft.estimation.moments.unknowns import State
from tests.estimation.moments.least_squares import STEP, jacobian_of_motion, jacobian_of_wrench, moved, wrench_residuals
from tests.estimation.moments.moving_team import (
    ERRORS,
    EVERY,
    EXACT,
    LATE,
    LATE_AND_LIMP,
    LIMP,
    NOISE,
    Team,
    body_at,
    carried_load,
    extended_for,
    make_team,
    uneven_noise,
    with_errors,
)

CASES = pytest.mark.parametrize(
    ("count", "errors"),
    [(2, EXACT), (3, EXACT), (6, EXACT), (3, ERRORS), (2, LATE), (3, LATE), (3, LIMP), (2, LATE_AND_LIMP)],
)


def evidence_of(body: BodyModel, moments: RowMoments) -> tuple[Evidence, Evidence]:
    """Of the motion and of the wrench."""
    seen, factors = evaluated_moments(body, moments, moments), MotionFactors.at(body)
    return motion_evidence(body, factors, seen.motion), wrench_evidence(
        body, WrenchDerivatives.at(body, factors.derivatives), seen.wrench
    )


def case(count: int, errors: SensorErrors, number: int = 8) -> tuple[BodyModel, Array]:
    """A body at the true state, and exact rows."""
    team = make_team(seed=count, count=count, number=number + 2 * errors.has_rates, offset=2.0)
    state, rows = with_errors(team, errors, np.random.default_rng(count), gyros=0.0)
    return body_at(state, errors, uneven_noise(count)), rows


def expected_moments(team: Team, errors: SensorErrors) -> RowMoments:
    """What noise of rows makes of their moments on the average."""
    rows = extended_for(errors, team.rows)
    variance = np.tile(np.concatenate([NOISE.kinematics[0] ** 2, NOISE.wrench[0] ** 2, np.zeros(6)]), team.count)
    factors = np.tile(np.concatenate([NOISE.rates[0] ** 2, np.zeros(6)]), team.count)
    more = [(variance * factors).reshape(team.count, -1)] if errors.has_rates else []
    more += [np.tile((NOISE.flexing * np.tile(NOISE.wrench[0, :3], 2)) ** 2, (team.count, 1))] * errors.is_flexing
    parts = [variance, [0.0], np.hstack(more).ravel() if more else []]
    return RowMoments(rows.T @ rows + len(rows) * np.diag(np.concatenate(parts)))


def assert_close(found: Array, expected: Array, tolerance: float) -> None:
    """In units in which the diagonal of what is expected is one."""
    diagonal = expected.diagonal()
    scale = np.sqrt(np.where(diagonal > 1e-9 * diagonal.max(), diagonal, diagonal.max()))
    np.testing.assert_allclose(found / np.outer(scale, scale), expected / np.outer(scale, scale), atol=tolerance)


@CASES
def test_information_of_the_motion_is_that_of_least_squares(count: int, errors: SensorErrors) -> None:
    body, rows = case(count, errors)
    found, _ = evidence_of(body, RowMoments.of(rows))
    by_unknowns, by_others = jacobian_of_motion(body, rows)
    left = by_unknowns - by_others @ np.linalg.lstsq(by_others, by_unknowns, rcond=1e-10)[0]
    assert_close(found.information + found.noise, left.T @ left, 1e-4)


@CASES
def test_information_of_the_wrench_is_that_of_least_squares(count: int, errors: SensorErrors) -> None:
    body, rows = case(count, errors)
    assert body.state.load is not None
    np.testing.assert_allclose(wrench_residuals(body, rows), 0.0, atol=1e-6)
    _, found = evidence_of(body, RowMoments.of(rows))
    weight, jacobian = np.linalg.inv(residual_covariance(body, body.state.load)), jacobian_of_wrench(body, rows)
    assert_close(found.information + found.noise, np.einsum("tiu,ij,tjv->uv", jacobian, weight, jacobian), 1e-4)


@EVERY
def test_noise_is_taken_out_of_score_and_information(errors: SensorErrors) -> None:
    team = make_team(seed=1, number=30, offset=2.0)
    body, rows = body_at(team.state(errors), errors), extended_for(errors, team.rows)
    pairs = zip(evidence_of(body, expected_moments(team, errors)), evidence_of(body, RowMoments.of(rows)), strict=True)
    for found, exact in pairs:
        whole = exact.information + exact.noise
        assert_close(found.information, whole, 1e-6)
        np.testing.assert_allclose(found.noise, exact.noise)
        deviations = np.sqrt(np.maximum(whole.diagonal(), 1.0))
        np.testing.assert_allclose(found.score / deviations, 0.0, atol=1e-5)


@CASES
def test_the_score_falls_by_the_information(count: int, errors: SensorErrors) -> None:
    team = make_team(seed=count, count=count, number=12, offset=2.0)
    body, moments = body_at(team.state(errors), errors), expected_moments(team, errors)
    here = evidence_of(body, moments)
    slopes: list[list[Array]] = [[], []]
    sizes = np.full(body.unknowns.size, STEP)
    sizes[body.unknowns.eta[:, [name == "grasp_compliance" for name in errors.names]]] = 1e-3 * STEP  # 10 µm/N is much
    for size, direction in zip(sizes, np.eye(body.unknowns.size), strict=True):
        step = size * direction
        plus, minus = evidence_of(moved(body, step), moments), evidence_of(moved(body, -step), moments)
        for slope, one, other in zip(slopes, plus, minus, strict=True):
            slope.append((one.score - other.score) / (2.0 * size))
    for slope, found in zip(slopes, here, strict=True):
        assert_close(-np.array(slope), found.information, 3e-3)  # noise is that of exact sensors


def test_scores_vary_as_they_claim() -> None:
    team, rng, repeated = make_team(seed=2, number=30, offset=2.0), np.random.default_rng(3), 800
    body = body_at(team.state())
    free = np.r_[6 : body.unknowns.gyros.start, body.unknowns.load]
    exact = evidence_of(body, expected_moments(team, EXACT))
    scores: list[list[Array]] = [[], []]
    information = np.zeros((2, body.unknowns.size, body.unknowns.size))
    for _ in range(repeated):
        for k, found in enumerate(evidence_of(body, RowMoments.of(team.noisy(rng)))):
            scores[k].append(found.score)
            information[k] += found.information / repeated
    for k, part in enumerate([free[:12], free]):
        which = np.ix_(part, part)
        spread = (exact[k].information + exact[k].noise)[which]
        white = np.linalg.solve(np.linalg.cholesky(spread), np.array(scores[k])[:, part].T)
        assert np.abs(white.mean(axis=1)).max() < 4.0 / np.sqrt(repeated)
        eigenvalues = np.linalg.eigvalsh(np.cov(white))
        assert eigenvalues[0] > 0.6
        assert eigenvalues[-1] < 1.5
        assert np.trace(np.cov(white)) / len(part) == pytest.approx(1.0, abs=0.05)
        assert_close(information[k][which], exact[k].information[which], 0.1)


def gauge(state: State, size: int, own: int) -> Array:
    """Steps (u, 6) that move all robots and the load together, by a rotation or a translation."""
    directions = np.zeros((size, 6))
    for axis in range(6):
        tangent = np.eye(6)[axis]
        for robot, pose in enumerate(state.poses):
            shift = np.cross(tangent[:3], pose.translation) + tangent[3:]
            directions[own * robot : own * robot + 6, axis] = np.concatenate([tangent[:3], shift])
        assert state.load is not None
        sides = [
            carried_load(state.load, Pose(rotation_exp(sign * STEP * tangent[:3]), sign * STEP * tangent[3:]))
            for sign in (1.0, -1.0)
        ]
        directions[-16:, axis] = (sides[0] - sides[1]) / (2.0 * STEP)
    return directions


@EVERY
def test_moving_all_together_shows_nothing(errors: SensorErrors) -> None:
    team = make_team(seed=4, number=30, offset=2.0)
    body = body_at(team.state(errors), errors)
    free = gauge(body.state, body.unknowns.size, body.unknowns.own)
    for found in evidence_of(body, expected_moments(team, errors)):
        scale = np.sqrt(np.abs(found.information).diagonal() @ free**2)
        np.testing.assert_allclose((free / scale).T @ found.information @ (free / scale), 0.0, atol=1e-7)
        np.testing.assert_allclose(found.score @ free / scale, 0.0, atol=1e-4)


def test_noise_says_nothing_about_all_together() -> None:
    team = make_team(seed=4, number=30)
    body = body_at(team.state())
    free, moments = gauge(body.state, body.unknowns.size, body.unknowns.own), team.noisy(np.random.default_rng(5))
    found, _ = evidence_of(body, RowMoments.of(moments))
    scale = np.sqrt(np.abs(found.information).diagonal() @ free**2)
    np.testing.assert_allclose((free / scale).T @ found.information @ (free / scale), 0.0, atol=1e-7)
    np.testing.assert_allclose(found.score @ free / scale, 0.0, atol=1e-6)


def test_turning_a_grasp_and_turning_all_its_sensors_are_one() -> None:
    sensors = ("gyro", "velocity", "acceleration", "force", "torque")
    errors = SensorErrors({f"{sensor}_mounting": 0.01 for sensor in sensors})
    team = make_team(seed=6, number=30)
    body = body_at(team.state(errors), errors)
    for robot, pose in enumerate(team.poses):
        together = np.zeros((body.unknowns.size, 3))
        together[body.unknowns.poses[robot, :3]] = np.eye(3)
        together[body.unknowns.eta[robot]] = -np.tile(pose.rotation.T, (5, 1))
        for found in evidence_of(body, expected_moments(team, errors)):
            scale = np.sqrt(found.information.diagonal() @ together**2)
            np.testing.assert_allclose(together.T @ found.information @ together / scale**2, 0.0, atol=1e-7)
            np.testing.assert_allclose(found.score @ together / scale, 0.0, atol=1e-4)


def test_noise_of_regressors_may_be_given() -> None:
    team = make_team(seed=7)
    body, moments = body_at(team.state()), RowMoments.of(team.noisy(np.random.default_rng(8)))
    seen, factors = evaluated_moments(body, moments, moments), MotionFactors.at(body)
    by_motion, by_wrench = evidence_of(body, moments)
    again = motion_evidence(body, factors, seen.motion, 2.0 * by_motion.noise)
    np.testing.assert_array_equal(again.noise, 2.0 * by_motion.noise)
    np.testing.assert_array_equal(again.information, by_motion.information)
    again = wrench_evidence(body, WrenchDerivatives.at(body, factors.derivatives), seen.wrench, 2.0 * by_wrench.noise)
    np.testing.assert_array_equal(again.noise, 2.0 * by_wrench.noise)
    np.testing.assert_array_equal(again.score, by_wrench.score)


@CASES
def test_information_on_theta_is_part_of_that_on_all_unknowns(count: int, errors: SensorErrors) -> None:
    body, rows = case(count, errors)
    moments = wrench_moments(body, RowMoments.of(rows))
    whole, theta = evidence_of(body, RowMoments.of(rows))[1].information, body.unknowns.theta
    found = information_on_theta(Derivatives(body), moments)
    unit = np.sqrt(np.maximum(whole.diagonal(), 1e-9 * whole.diagonal().max()))
    np.testing.assert_allclose(found / np.outer(unit, unit[theta]), (whole / np.outer(unit, unit))[:, theta], atol=1e-9)


def test_the_table_makes_information_of_the_load() -> None:
    team = make_team(seed=9, number=12)
    body, forcing = body_at(team.state()), team.psi[:, FORCING]
    weight = np.linalg.inv(residual_covariance(body, team.load))
    found = ((forcing.T @ forcing).ravel() @ information_table(weight)).reshape(16, 16)
    by_load = jacobian_of_wrench(body, team.rows)[:, :, body.unknowns.load]
    assert_close(found, np.einsum("tiu,ij,tjv->uv", by_load, weight, by_load), 1e-6)

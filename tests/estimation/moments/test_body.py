"""The body's motion and the total wrench that rows show at one state: exact without noise, and honest with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coheft.estimation.geometry.body_motion import grasp_measurements
from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp
from coheft.estimation.moments.body import (
    ACCELERATIONS,
    FORCING,
    MOTION_SIZE,
    PRODUCTS,
    TWIST,
    BodyModel,
    load_operator,
    residual_covariance,
)
from coheft.estimation.moments.rows import ROW_SIZE, RowNoise
from coheft.estimation.moments.sensor_errors import SensorErrors
from coheft.estimation.rigid_body.regressor import symmetric_products
from tests.estimation.moments.moving_team import (
    EVERY,
    LATE,
    LATE_AND_LIMP,
    LIMP,
    NOISE,
    Team,
    body_at,
    by_robot,
    extended_for,
    make_team,
    noisy_for,
    uneven_noise,
    with_errors,
    with_rates,
)

COUNTS = pytest.mark.parametrize("count", [1, 2, 3, 6])
FRAME = Pose(rotation_exp([0.3, -1.0, 0.5]), np.array([0.4, -0.2, 0.7]))


def fused(team: Team, row: Array, noise: RowNoise) -> Array:
    """``(w, v, a, alpha)`` by weighted least squares of one row (24 N + 1,), with the products that gyros show."""
    own = row[:-1].reshape(team.count, ROW_SIZE)
    weights = np.broadcast_to(noise.kinematics**-2.0, (team.count, 12))
    products = np.zeros((3, 3))
    for pose, y, weight in zip(team.poses, own, weights, strict=True):
        matrix = y[18:][[[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
        products += weight[0] / weights[:, 0].sum() * pose.rotation @ matrix @ pose.rotation.T
    design, read = [], []
    for pose, y, weight in zip(team.poses, own, weights, strict=True):
        model = np.array([np.hstack(_without_products(pose, axis)) for axis in np.eye(12)]).T
        y = y[:12].copy()
        y[6:9] -= pose.rotation.T @ (products - np.trace(products) * np.eye(3)) @ pose.translation
        design.append(np.sqrt(weight)[:, None] * model)
        read.append(np.sqrt(weight) * y)
    return np.linalg.lstsq(np.vstack(design), np.concatenate(read), rcond=None)[0]


def _without_products(pose: Pose, motion: Array) -> tuple[Array, ...]:
    w, v, a, alpha = motion.reshape(4, 3)
    p, to_own = pose.translation, pose.rotation.T
    return to_own @ w, to_own @ (v + np.cross(w, p)), to_own @ (a + np.cross(alpha, p)), to_own @ alpha


@COUNTS
@EVERY
def test_exact_rows_show_the_exact_motion_and_wrench(count: int, errors: SensorErrors) -> None:
    team = make_team(seed=1, count=count, number=20, offset=3.0)
    state, rows = with_errors(team, errors, np.random.default_rng(2))
    body = body_at(state, errors)
    psi = np.hstack([team.psi, np.ones((20, 1))])
    psi = with_rates(psi) if errors.has_rates else psi
    psi = np.hstack([psi[:, :MOTION_SIZE], psi[:, MOTION_SIZE + 1 :]])
    if errors.is_flexing:
        psi = np.hstack([psi, by_robot(rows, count)[:, :, -6:].reshape(len(rows), -1)])
    np.testing.assert_allclose(rows @ body.motion_map.T, psi, atol=1e-5)
    wrench = team.total_wrench + team.load[:6]
    np.testing.assert_allclose(rows @ body.wrench_map.T, wrench[1:-1] if errors.has_rates else wrench, atol=1e-9)
    residuals = body.residuals(rows, rows @ body.motion_map[:MOTION_SIZE].T).reshape(len(rows), count, 12)
    residuals[:, :, :6] -= residuals[0, :, :6]  # what gyros always read in excess is the same in all rows
    np.testing.assert_allclose(residuals, 0.0, atol=1e-4)


@EVERY
def test_exact_rows_leave_no_residuals(errors: SensorErrors) -> None:
    team = make_team(seed=22, number=20)
    rows = extended_for(errors, team.rows)
    body = body_at(team.state(errors), errors)
    np.testing.assert_allclose(body.residuals(rows, rows @ body.motion_map[:MOTION_SIZE].T), 0.0, atol=1e-5)


@pytest.mark.parametrize("count", [2, 3, 6])
def test_noisy_rows_are_fused_by_weighted_least_squares(count: int) -> None:
    team = make_team(seed=3, count=count, number=10)
    noise = uneven_noise(team.count)
    rows, body = team.noisy(np.random.default_rng(4), noise), body_at(team.state(), noise=noise)
    expected = [fused(team, row, noise) for row in rows]
    np.testing.assert_allclose((rows @ body.motion_map.T)[:, 1:13], expected, atol=1e-7)


@EVERY
def test_residuals_are_what_predictions_leave(errors: SensorErrors) -> None:
    team, rng = make_team(seed=5, number=20), np.random.default_rng(6)
    state, rows = with_errors(team, errors, rng)
    rows = rows + 0.01 * rng.normal(size=rows.shape) * (np.arange(rows.shape[1]) != 72)
    body = body_at(state, errors, uneven_noise(team.count))
    calibrated = by_robot(rows, team.count)
    if state.calibration is not None:
        calibrated = np.einsum("nij,tnj->tni", state.calibration, calibrated)
    left = calibrated[:, :, :12] - np.einsum("nij,tj->tni", body.predict, (rows @ body.motion_map.T)[:, :MOTION_SIZE])
    whitened = (left / uneven_noise(team.count).kinematics).reshape(len(rows), -1)
    np.testing.assert_allclose(body.residuals(rows, rows @ body.motion_map[:MOTION_SIZE].T), whitened, atol=1e-7)


@COUNTS
def test_predictions_are_what_sensors_read(count: int) -> None:
    team = make_team(seed=7, count=count, number=5)
    body, own = body_at(team.state(LATE), LATE), team.rows[:, :-1].reshape(5, count, ROW_SIZE)
    np.testing.assert_allclose(np.einsum("nij,tj->tni", body.predict, team.psi), own[:, :, :12], atol=1e-12)
    products = np.einsum("nij,tj->tni", body.predict_products, team.psi[:, PRODUCTS])
    np.testing.assert_allclose(products, own[:, :, 18:], atol=1e-12)
    rates = np.random.default_rng(8).normal(size=(5, MOTION_SIZE))
    predicted = np.einsum("nij,tj->tni", body.predicted_rows(), np.hstack([team.psi, rates]))
    expected = by_robot(team.rows, count)
    np.testing.assert_allclose(predicted[:, :, :12], expected[:, :, :12], atol=1e-12)
    np.testing.assert_allclose(predicted[:, :, 18:25], expected[:, :, 18:], atol=1e-12)
    np.testing.assert_allclose(predicted[:, :, 25:37], np.einsum("nij,tj->tni", body.predict, rates), atol=1e-12)
    products = np.einsum("nij,tj->tni", body.predict_products, rates[:, PRODUCTS])
    np.testing.assert_allclose(predicted[:, :, 43:], products, atol=1e-12)


def test_another_body_frame_shows_the_motion_of_that_frame() -> None:
    team, noise = make_team(seed=9, number=10), NOISE
    other = team.expressed_in(FRAME)
    rows = team.noisy(np.random.default_rng(10))
    psi = rows @ body_at(team.state(), noise=noise).motion_map.T
    seen = rows @ body_at(other.state(), noise=noise).motion_map.T
    turned = np.hstack([grasp_measurements(FRAME, psi[:, 1:13]), psi[:, 10:13] @ FRAME.rotation])
    # Products are those of the gyros alone, so what is centripetal follows them, and not the fused angular velocity.
    matrices = psi[:, PRODUCTS][:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
    square = matrices - np.trace(matrices, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    at_frame = psi[:, 7:10] + np.cross(psi[:, 10:13], FRAME.translation) + square @ FRAME.translation
    turned[:, 6:9] = at_frame @ FRAME.rotation
    np.testing.assert_allclose(seen[:, 1:13], turned, atol=1e-6)
    wrench = rows @ body_at(team.state(), noise=noise).wrench_map.T
    np.testing.assert_allclose(
        rows @ body_at(other.state()).wrench_map.T, wrench @ FRAME.inverse().adjoint().T, atol=1e-9
    )


@pytest.mark.parametrize("sensor", [slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)])
def test_a_sensor_that_is_not_there_says_nothing(sensor: slice) -> None:
    team, rng = make_team(seed=11, count=4, number=10), np.random.default_rng(12)
    kinematics = np.repeat(NOISE.kinematics, 4, axis=0)
    kinematics[2, sensor] = np.inf
    rows, noise = team.noisy(rng), RowNoise(kinematics, NOISE.wrench)
    body, garbage = body_at(team.state(), noise=noise), rows.copy()
    own = garbage[:, :-1].reshape(10, 4, ROW_SIZE)
    own[:, 2, sensor] = 100.0 * rng.normal(size=(10, 3))
    if sensor.start == 0:
        own[:, 2, 18:] = 100.0 * rng.normal(size=(10, 6))
    np.testing.assert_allclose(garbage @ body.motion_map.T, rows @ body.motion_map.T, atol=1e-8)
    motion = rows @ body.motion_map[:MOTION_SIZE].T
    np.testing.assert_allclose(body.residuals(garbage, motion), body.residuals(rows, motion), atol=1e-6)


def test_a_robot_without_motion_sensors_is_as_if_it_were_not_there() -> None:
    team = make_team(seed=13, count=4, number=10)
    kinematics = np.repeat(NOISE.kinematics, 4, axis=0)
    kinematics[3] = np.inf
    rows, fewer = team.noisy(np.random.default_rng(14)), team.permuted([0, 1, 2])
    body, without = body_at(team.state(), noise=RowNoise(kinematics, NOISE.wrench)), body_at(fewer.state())
    psi = np.delete(rows, slice(72, 96), axis=1) @ without.motion_map.T
    np.testing.assert_allclose(rows @ body.motion_map.T, psi, atol=1e-9)
    np.testing.assert_allclose(body.motion_noise, without.motion_noise, rtol=1e-6, atol=1e-15)


def test_a_wrench_sensor_that_is_not_there_makes_its_wrench_unknown() -> None:
    team = make_team(seed=15, number=10)
    wrench = np.repeat(NOISE.wrench, 3, axis=0)
    wrench[1, 3:] = np.inf
    body = body_at(team.state(), noise=RowNoise(NOISE.kinematics, wrench))
    np.testing.assert_array_equal(body.wrench_covariance[1, 3:], 0.0)
    weight = np.linalg.inv(residual_covariance(body, team.load))
    known = np.linalg.inv(residual_covariance(body_at(team.state()), team.load))
    assert np.abs(weight[3:, 3:]).max() < 1e-9
    assert np.trace(weight[:3, :3]) > 0.3 * np.trace(known[:3, :3])


@EVERY
def test_noise_of_the_motion_is_as_claimed(errors: SensorErrors) -> None:
    team, rng = make_team(seed=16, number=2000, turning=0.0, moving=0.0), np.random.default_rng(17)
    noise, state = replace(uneven_noise(team.count), rates=NOISE.rates), team.state(errors)
    rows = noisy_for(errors, team, rng, noise)
    body = body_at(state, errors, noise)
    psi = (rows - extended_for(errors, team.rows)) @ body.motion_map.T
    for part in (TWIST, ACCELERATIONS):
        found = np.cov(psi[:, part].T)
        white = np.linalg.solve(body.motion_noise[part, part], found)
        assert np.trace(white) / 6.0 == pytest.approx(1.0, abs=5.0 / np.sqrt(3.0 * len(rows)))
        np.testing.assert_allclose(np.sqrt(found.diagonal() / body.motion_noise.diagonal()[part]), 1.0, atol=0.12)
        if errors.has_rates:
            rates = slice(MOTION_SIZE + part.start, MOTION_SIZE + part.stop)
            white = np.linalg.solve(body.motion_noise[rates, rates], np.cov(psi[:, rates].T))
            assert np.trace(white) / 6.0 == pytest.approx(1.0, abs=5.0 / np.sqrt(3.0 * len(rows)))


def test_noise_of_rates_is_in_what_late_sensors_read() -> None:
    team, rng, number = make_team(seed=20, number=20_002, turning=0.0, moving=0.0), np.random.default_rng(21), 20_000
    noise, (state, exact) = replace(uneven_noise(3), rates=NOISE.rates), with_errors(team, LATE, rng, gyros=0.0)
    body = body_at(state, LATE, noise)
    rows = exact + noisy_for(LATE, team, rng, noise) - extended_for(LATE, team.rows)
    rows[:, 18:24] = rows[:, 42:48] = rows[:, 66:72] = 0.0  # products of noise are not what this is about
    exact[:, 18:24] = exact[:, 42:48] = exact[:, 66:72] = 0.0
    motion, expected = rows @ body.motion_map.T, exact @ body.motion_map.T
    psi = motion - expected
    residual = body.residuals(rows, motion[:, :MOTION_SIZE]) - body.residuals(exact, expected[:, :MOTION_SIZE])
    deviations = np.sqrt(np.maximum(body.motion_noise.diagonal(), 1e-30))
    for one in (TWIST, ACCELERATIONS):
        late = slice(MOTION_SIZE + one.start, MOTION_SIZE + one.stop)
        for other in (one, late):
            found = psi[:, one].T @ psi[:, other] / number
            scale = np.outer(deviations[one], deviations[other])
            np.testing.assert_allclose(found / scale, body.motion_noise[one, other] / scale, atol=5.0 / number**0.5)
        own = slice(0, 6) if one is TWIST else slice(6, 12)
        read = residual.reshape(number, -1, 12)[:, :, own].reshape(number, -1)
        assert body.residual_noise is not None
        claimed = (np.sqrt(body.weight)[..., None] * body.residual_noise)[:, own].reshape(read.shape[1], -1)
        scale = deviations[late]
        np.testing.assert_allclose(
            read.T @ psi[:, late] / number / scale, claimed[:, late] / scale, atol=5.0 / number**0.5
        )
        assert np.abs(claimed[:, late] / scale).max() > 0.05
        np.testing.assert_allclose(read.T @ psi[:, one] / number / deviations[one], 0.0, atol=5.0 / number**0.5)


@pytest.mark.parametrize("errors", [LIMP, LATE_AND_LIMP], ids=["limp", "late and limp"])
def test_noise_of_forces_is_in_what_compliant_robots_read(errors: SensorErrors) -> None:
    number, rng = 20_000, np.random.default_rng(24)
    team = make_team(seed=23, number=number + 2 * errors.has_rates, turning=0.0, moving=0.0)
    noise, (state, exact) = replace(uneven_noise(3), flexing=NOISE.flexing), with_errors(team, errors, rng, gyros=0.0)
    body = body_at(state, errors, noise)
    rows = exact + noisy_for(errors, team, rng, noise) - extended_for(errors, team.rows)
    rows[:, 18:24] = rows[:, 42:48] = rows[:, 66:72] = 0.0  # products of noise are not what this is about
    exact[:, 18:24] = exact[:, 42:48] = exact[:, 66:72] = 0.0
    motion, expected = rows @ body.motion_map.T, exact @ body.motion_map.T
    psi = motion - expected
    residual = body.residuals(rows, motion[:, :MOTION_SIZE]) - body.residuals(exact, expected[:, :MOTION_SIZE])
    assert body.residual_noise is not None
    claimed = (np.sqrt(body.weight)[..., None] * body.residual_noise).reshape(residual.shape[1], -1)
    used = np.concatenate([np.r_[1:13], body.flexing.ravel()])
    deviations = np.sqrt(body.motion_noise.diagonal()[used])
    scale, square = np.outer(deviations, deviations), np.ix_(used, used)
    np.testing.assert_allclose((psi.T @ psi)[square] / number / scale, body.motion_noise[square] / scale, atol=0.05)
    np.testing.assert_allclose(
        (residual.T @ psi)[:, used] / number / deviations, claimed[:, used] / deviations, atol=0.05
    )
    assert np.abs(claimed[:, body.flexing.ravel()] / deviations[12:]).max() > 0.3


def test_noise_of_the_wrench_is_as_claimed() -> None:
    team, rng = make_team(seed=18, number=2000), np.random.default_rng(19)
    noise = uneven_noise(team.count)
    body = body_at(team.state(), noise=noise)
    residual = team.noisy(rng, noise) @ (body.wrench_map - load_operator(team.load) @ body.motion_map[FORCING]).T
    white = np.linalg.solve(residual_covariance(body, team.load), np.cov(residual.T))
    assert np.trace(white) / 6.0 == pytest.approx(1.0, abs=5.0 / np.sqrt(6000.0))
    np.testing.assert_allclose(white, np.eye(6), atol=0.15)


def test_the_load_s_operator_is_newton_s_and_euler_s_law() -> None:
    team = make_team(seed=20, number=10, offset=2.0)
    wrench = team.psi[:, FORCING] @ load_operator(team.load).T
    np.testing.assert_allclose(wrench, team.total_wrench + team.load[:6], atol=1e-10)
    products = symmetric_products(team.motion[:, :3])
    np.testing.assert_array_equal(team.psi[:, FORCING], np.hstack([team.psi[:, [0, *range(7, 13)]], products]))


def test_all_robots_alike_need_one_row_of_noise() -> None:
    state = make_team(seed=21).state()
    one, many = (
        body_at(state),
        body_at(state, noise=RowNoise(np.repeat(NOISE.kinematics, 3, 0), np.repeat(NOISE.wrench, 3, 0))),
    )
    for name in ("motion_map", "wrench_map", "motion_noise", "wrench_noise", "weight", "shares"):
        found, expected = getattr(one, name), getattr(many, name)  # where arrays lie decides about the last digit
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-14 * np.abs(expected).max())
    assert isinstance(one, BodyModel)

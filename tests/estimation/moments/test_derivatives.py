"""Derivatives against differences of what they are derivatives of, when the state moves."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.body import (
    ACCELERATIONS,
    FORCING,
    MOTION_SIZE,
    PRODUCTS,
    BodyModel,
    load_operator,
    residual_covariance,
)
from coheft.estimation.moments.derivatives import MotionDerivatives, WrenchDerivatives, prediction_covariance
from coheft.estimation.moments.moments import wrench_indices
from coheft.estimation.moments.rows import ROW_SIZE
from coheft.estimation.moments.sensor_errors import SensorErrors
from coheft.estimation.moments.unknowns import State
from tests.estimation.moments.moving_team import (
    EVERY,
    EXACT,
    body_at,
    by_robot,
    make_team,
    uneven_noise,
    with_errors,
)

COUNTS = pytest.mark.parametrize("count", [2, 3, 6])
STEP = 1e-5
ROWS = 4


def case(count: int, errors: SensorErrors, seed: int = 1) -> tuple[BodyModel, Array]:
    """A body with errors of its sensors, and exact rows."""
    team = make_team(seed, count=count, number=ROWS + 2 * errors.has_rates, offset=2.0)
    state, rows = with_errors(team, errors, np.random.default_rng(seed), gyros=0.0)
    return body_at(state, errors, uneven_noise(count)), rows


def moved(body: BodyModel, index: int, size: float) -> BodyModel:
    step = np.zeros(body.unknowns.size)
    step[index] = size
    return body_at(body.state.moved(step, body.unknowns, 1e9), body.unknowns.errors, body.noise)


def both_sides(body: BodyModel, index: int) -> tuple[BodyModel, BodyModel]:
    return moved(body, index, STEP), moved(body, index, -STEP)


def residuals(body: BodyModel, rows: Array) -> Array:
    """Of the accelerations and slopes, and of the twists about their mean, of all robots, shape (n, N, 12)."""
    white = body.residuals(rows, rows @ body.motion_map[:MOTION_SIZE].T).reshape(len(rows), body.count, 12)
    left: Array = white / np.sqrt(body.weight)
    left[:, :, :6] -= left[:, :, :6].mean(axis=0)
    return left


def rho(body: BodyModel, rows: Array) -> Array:
    """Residual of the total wrench, shape (n, 6)."""
    assert body.state.load is not None
    return rows @ (body.wrench_map - load_operator(body.state.load) @ body.motion_map[FORCING]).T


def calibrated_wrenches(state: State, rows: Array) -> Array:
    """Robot by robot, with their rates if there are any, shape (n, w N)."""
    count = len(state.poses)
    if state.calibration is None:
        return rows[:, wrench_indices(count, EXACT)]
    own = np.einsum("nij,tnj->tni", state.calibration, by_robot(rows, count))
    parts = [own[:, :, 12:18]] + ([own[:, :, 37:43]] if own.shape[2] > 2 * ROW_SIZE else [])
    return np.concatenate(parts, axis=2).reshape(len(rows), -1)


@COUNTS
@EVERY
def test_of_predictions(count: int, errors: SensorErrors) -> None:
    body, _ = case(count, errors)
    found = body.prediction_derivatives()
    assert not found[..., 19:].any()
    for robot in range(count):
        for k, index in enumerate(body.unknowns.poses[robot]):
            plus, minus = both_sides(body, index)
            expected = (plus.predict - minus.predict) / (2.0 * STEP)
            np.testing.assert_allclose(found[robot, k, :, :19], expected[robot], atol=1e-8)
            assert not np.delete(expected, robot, axis=0).any()


@COUNTS
def test_of_adjoints(count: int) -> None:
    body, _ = case(count, EXACT)
    found = body.adjoint_derivatives()
    for robot in range(count):
        for k, index in enumerate(body.unknowns.poses[robot]):
            plus, minus = both_sides(body, index)
            expected = (plus.adjoints - minus.adjoints)[robot] / (2.0 * STEP)
            np.testing.assert_allclose(found[robot, k], expected, atol=1e-8)


@COUNTS
@EVERY
def test_of_products(count: int, errors: SensorErrors) -> None:
    body, rows = case(count, errors)
    common, psi = MotionDerivatives.at(body).common, rows @ body.motion_map.T
    for index in range(body.unknowns.motion_size):
        plus, minus = both_sides(body, index)
        expected = (rows @ (plus.motion_map - minus.motion_map).T)[:, PRODUCTS] / (2.0 * STEP)
        np.testing.assert_allclose(psi @ common[index].T, expected, atol=2e-7)


@EVERY
def test_of_products_by_the_gyros_whatever_these_read_in_excess(errors: SensorErrors) -> None:
    team = make_team(2, number=ROWS)
    state, rows = with_errors(team, errors, np.random.default_rng(3), gyros=0.3)
    body = body_at(state, errors)
    common, psi = MotionDerivatives.at(body).common, rows @ body.motion_map.T
    for index in range(body.unknowns.gyros.start, body.unknowns.gyros.stop):
        plus, minus = both_sides(body, index)
        expected = (rows @ (plus.motion_map - minus.motion_map).T)[:, PRODUCTS] / (2.0 * STEP)
        np.testing.assert_allclose(psi @ common[index].T, expected, atol=2e-7)


@COUNTS
@EVERY
def test_of_fused_accelerations(count: int, errors: SensorErrors) -> None:
    body, rows = case(count, errors)
    found, psi = MotionDerivatives.at(body).found, rows @ body.motion_map.T
    for index in range(body.unknowns.motion_size):
        plus, minus = both_sides(body, index)
        expected = (rows @ (plus.motion_map - minus.motion_map).T)[:, ACCELERATIONS] / (2.0 * STEP)
        now = psi @ (-body.accelerations.covariance @ found[index]).T
        np.testing.assert_allclose(now, expected, atol=1e-6)


@COUNTS
@EVERY
def test_of_residuals_of_motion(count: int, errors: SensorErrors) -> None:
    body, rows = case(count, errors)
    derivatives, psi, unknowns = MotionDerivatives.at(body), rows @ body.motion_map.T, body.unknowns
    design = body.predict[:, :, 1:13]
    information = np.einsum("nki,nk,nkj->ij", design, body.weight, design)
    for index in range(unknowns.motion_size):
        change = -np.einsum("nij,mj->mni", body.predict[:, :, PRODUCTS], psi @ derivatives.common[index].T)
        robot, own = divmod(index, unknowns.own)
        if robot < count:
            change[:, robot] -= psi @ derivatives.own[robot, own].T
        change[:, :, :6] -= change[:, :, :6].mean(axis=0)
        # The motion is fitted to what has changed.
        weighted = np.einsum("nki,nk,mnk->mi", design, body.weight, change)
        change -= np.einsum("nki,mi->mnk", design, np.linalg.solve(information, weighted.T).T)
        plus, minus = both_sides(body, index)
        expected = (residuals(plus, rows) - residuals(minus, rows)) / (2.0 * STEP)
        np.testing.assert_allclose(change, expected, atol=1e-5)


@COUNTS
@EVERY
def test_of_uncertain_predictions(count: int, errors: SensorErrors) -> None:
    body, rows = case(count, errors)
    derivatives, psi, root = MotionDerivatives.at(body), rows @ body.motion_map.T, np.sqrt(body.weight)
    for index in range(body.unknowns.motion_size):
        alone = np.zeros((body.unknowns.size, body.unknowns.size))
        alone[index, index] = 1.0
        plus, minus = both_sides(body, index)
        expected = (residuals(plus, rows) - residuals(minus, rows))[0] / (2.0 * STEP)
        for robot in range(count):
            found = prediction_covariance(body, derivatives, alone, robot, psi[0], psi[0] - psi.mean(axis=0))
            found = found / np.outer(root[robot], root[robot])
            np.testing.assert_allclose(found, np.outer(expected[robot], expected[robot]), atol=1e-5, rtol=1e-4)


@COUNTS
@EVERY
def test_of_the_residual_of_the_wrench(count: int, errors: SensorErrors) -> None:
    body, rows = case(count, errors)
    unknowns, load = body.unknowns, body.state.load
    assert load is not None
    root = np.linalg.cholesky(np.linalg.inv(residual_covariance(body, load))).T
    found = WrenchDerivatives.at(body, MotionDerivatives.at(body))
    psi, wrenches = rows @ body.motion_map.T, calibrated_wrenches(body.state, rows)
    residual = wrenches @ found.of_wrenches.T + psi @ found.of_motion.T
    np.testing.assert_allclose(residual, rho(body, rows) @ root.T, atol=1e-8)
    by_own = wrenches.reshape(len(rows), count, -1)
    for index in range(unknowns.size):
        change = psi @ found.common[index].T
        robot, own = divmod(index, unknowns.own)
        if robot < count:
            change = change + by_own[:, robot] @ found.local[robot, own].T
        plus, minus = both_sides(body, index)
        expected = (rho(plus, rows) - rho(minus, rows)) @ root.T / (2.0 * STEP)
        np.testing.assert_allclose(change, expected, rtol=1e-6, atol=1e-6 * max(1.0, float(np.abs(expected).max())))


def test_the_wrench_s_covariance_and_root_make_residuals_white() -> None:
    body, _ = case(3, EXACT)
    assert body.state.load is not None
    covariance = residual_covariance(body, body.state.load)
    root = np.linalg.cholesky(np.linalg.inv(covariance)).T
    np.testing.assert_allclose(root @ covariance @ root.T, np.eye(6), atol=1e-9)


@EVERY
def test_nothing_of_the_wrench_depends_on_the_velocity(errors: SensorErrors) -> None:
    body, _ = case(3, errors)
    assert body.state.load is not None
    derivatives = MotionDerivatives.at(body)
    found = WrenchDerivatives.at(body, derivatives)
    others = np.setdiff1d(np.arange(body.features), body.without_velocity)
    for each in (derivatives.common, derivatives.found, found.common, found.of_motion):
        assert not each[..., others].any()

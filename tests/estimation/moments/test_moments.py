"""Second moments of rows, against sums over the rows."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.body import FORCING, BodyModel
from coheft.estimation.moments.moments import (
    MotionMoments,
    ProjectedMoments,
    RowMoments,
    WrenchMoments,
    evaluated_moments,
    robot_indices,
    view_moments,
    wrench_indices,
    wrench_moments,
)
from coheft.estimation.moments.rows import ROW_SIZE
from coheft.estimation.moments.sensor_errors import SensorErrors
from tests.estimation.moments.moving_team import (
    ERRORS,
    EVERY,
    LATE,
    body_at,
    by_robot,
    extended_for,
    make_team,
    with_errors,
)

COUNTS = pytest.mark.parametrize("count", [1, 2, 5])


def case(count: int, errors: SensorErrors) -> tuple[BodyModel, Array]:
    """Noisy rows, and a body at a state with errors of sensors that rows know nothing of."""
    team, rng = make_team(seed=1, count=count, number=30), np.random.default_rng(2)
    return body_at(with_errors(team, errors, rng)[0], errors), extended_for(errors, team.noisy(rng))


def calibrated(body: BodyModel, rows: Array) -> Array:
    """Shape (n, N, width)."""
    own = by_robot(rows, body.count)
    return own if body.state.calibration is None else np.einsum("nij,tnj->tni", body.state.calibration, own)


def assert_of_motion(moments: MotionMoments, body: BodyModel, rows: Array) -> None:
    psi = rows @ body.motion_map.T
    expected = np.einsum("tni,tj->nij", calibrated(body, rows)[:, :, :12], psi)
    np.testing.assert_allclose(moments.with_motion, expected, rtol=1e-9, atol=1e-7)
    np.testing.assert_allclose(moments.of_motion, psi.T @ psi, rtol=1e-9, atol=1e-7)
    assert moments.number == pytest.approx(len(rows))


def assert_of_wrenches(moments: WrenchMoments, body: BodyModel, rows: Array) -> None:
    psi, own = rows @ body.motion_map.T, calibrated(body, rows)
    indices = np.r_[12:18, 37:43] if body.has_rates else np.r_[12:18]
    wrenches = own[:, :, indices].reshape(len(rows), -1)
    np.testing.assert_allclose(moments.of_wrenches, wrenches.T @ wrenches, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(moments.with_motion, wrenches.T @ psi, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(moments.of_motion, psi.T @ psi, rtol=1e-9, atol=1e-6)
    assert moments.number == pytest.approx(len(rows))


@COUNTS
@EVERY
def test_of_all_rows_and_of_those_of_the_load(count: int, errors: SensorErrors) -> None:
    body, rows = case(count, errors)
    everything, load = RowMoments.of(rows), RowMoments.of(rows[10:])
    moments = evaluated_moments(body, everything, load)
    assert_of_motion(moments.motion, body, rows)
    assert_of_wrenches(moments.wrench, body, rows[10:])
    assert_of_wrenches(wrench_moments(body, load), body, rows[10:])


@COUNTS
@EVERY
def test_of_a_load_that_has_never_changed(count: int, errors: SensorErrors) -> None:
    body, rows = case(count, errors)
    everything = RowMoments.of(rows)
    moments = evaluated_moments(body, everything, everything)
    assert_of_motion(moments.motion, body, rows)
    assert_of_wrenches(moments.wrench, body, rows)


def test_constant_errors_of_wrenches_are_calibrated() -> None:
    body, rows = case(2, ERRORS)
    calibration = body.state.calibration
    assert calibration is not None
    calibration[:, 12:18, ROW_SIZE] = np.random.default_rng(3).normal(size=(2, 6))
    assert_of_wrenches(wrench_moments(body, RowMoments.of(rows)), body, rows)


@COUNTS
@EVERY
def test_of_views(count: int, errors: SensorErrors) -> None:
    body, rows = case(count, errors)
    views = np.hstack([rows @ body.motion_map[FORCING].T, rows @ body.wrench_map.T])
    assert views.shape == (len(rows), 19)
    for moments in (RowMoments.of(rows), ProjectedMoments.of(rows, body)):
        np.testing.assert_allclose(view_moments(body, moments), views.T @ views, rtol=1e-9, atol=1e-6)


def test_views_of_a_body_with_a_constant_in_its_wrench() -> None:
    body, rows = case(2, ERRORS)
    body.wrench_map[:, ROW_SIZE * 2] = np.arange(6.0)
    views = np.hstack([rows @ body.motion_map[FORCING].T, rows @ body.wrench_map.T])
    np.testing.assert_allclose(view_moments(body, RowMoments.of(rows)), views.T @ views, rtol=1e-9, atol=1e-6)


def test_moments_add_up() -> None:
    body, rows = case(2, LATE)
    one, other, both = RowMoments.of(rows[:12]), RowMoments.of(rows[12:]), RowMoments.of(rows)
    np.testing.assert_allclose((one + other).matrix, both.matrix, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose((both - other).matrix, one.matrix, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(both.sums(2 * ROW_SIZE), rows.sum(axis=0), rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(both.with_motion(body), rows.T @ (rows @ body.motion_map.T), rtol=1e-9, atol=1e-6)


@EVERY
def test_places_of_robots_and_of_their_wrenches(errors: SensorErrors) -> None:
    indices, wrenches = robot_indices(3, errors), wrench_indices(3, errors).reshape(3, -1)
    row = 1000.0 * np.arange(3)[:, None] + np.arange(24 + errors.more)
    x = np.concatenate([row[:, :24].ravel(), [1.0], row[:, 24:].ravel()])
    np.testing.assert_array_equal(x[indices], row)
    for robot in range(3):
        own = 24 * robot + np.arange(12, 18)
        rates = 73 + errors.more * robot + np.arange(12, 18)
        np.testing.assert_array_equal(wrenches[robot], np.r_[own, rates] if errors.has_rates else own)

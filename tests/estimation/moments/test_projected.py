"""Moments as seen from one state: the same as those of rows there, and for exact rows everywhere."""

from __future__ import annotations

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.moments import (
    ProjectedMoments,
    RowMoments,
    evaluated_moments,
    motion_then_to_now,
    wrench_indices,
)
from coheft.estimation.moments.rows import ROW_SIZE
from coheft.estimation.moments.sensor_errors import SensorErrors
from coheft.estimation.moments.unknowns import State, Unknowns
from tests.estimation.moments.moving_team import EVERY, EXACT, body_at, make_team, noisy_for, with_errors


def nearby(state: State, errors: SensorErrors, size: float = 0.05) -> State:
    """Another state: other poses, errors and offsets of gyros."""
    unknowns = Unknowns(len(state.poses), errors)
    step = size * np.random.default_rng(3).normal(size=unknowns.size)
    step[unknowns.eta] = errors.deviations * np.random.default_rng(4).normal(size=unknowns.eta.shape)
    return state.moved(step, unknowns, 6.0)


def assert_same(
    one: RowMoments | ProjectedMoments,
    other: RowMoments | ProjectedMoments,
    state: State,
    errors: SensorErrors,
    tolerance: float,
) -> None:
    """At a state, to this share of the largest entry."""
    body = body_at(state, errors)
    left, right = evaluated_moments(body, one, one), evaluated_moments(body, other, other)
    for kind in ("motion", "wrench"):
        for name, expected in vars(getattr(right, kind)).items():
            found = getattr(getattr(left, kind), name)
            largest = np.abs(expected).max()
            np.testing.assert_allclose(found, expected, atol=tolerance * largest, err_msg=f"{kind} {name}")


def noisy(errors: SensorErrors) -> tuple[State, Array]:
    team, rng = make_team(seed=1, number=30), np.random.default_rng(2)
    return with_errors(team, errors, rng)[0], noisy_for(errors, team, rng)


@EVERY
def test_from_where_they_were_seen_all_is_exact(errors: SensorErrors) -> None:
    state, rows = noisy(errors)
    body = body_at(state, errors)
    assert_same(ProjectedMoments.of(rows, body), RowMoments.of(rows), state, errors, 1e-10)
    projected = ProjectedMoments.of(rows, body)
    one = ROW_SIZE * 3
    np.testing.assert_allclose(projected.sums(one), rows.sum(axis=0), rtol=1e-9, atol=1e-7)
    wrenches = rows[:, wrench_indices(3, errors)]
    np.testing.assert_allclose(projected.of_wrenches(np.arange(3)), wrenches.T @ wrenches, rtol=1e-12)


@EVERY
def test_exact_rows_turned_to_the_true_state_are_exact(errors: SensorErrors) -> None:
    team = make_team(seed=5, number=30)
    truth, rows = with_errors(team, errors, np.random.default_rng(6))
    then = body_at(nearby(truth, errors), errors)
    projected = ProjectedMoments.of(rows, then)
    assert_same(projected, RowMoments.of(rows), truth, errors, 1e-7)
    turned = ProjectedMoments.at(body_at(truth, errors), projected)
    assert_same(turned, RowMoments.of(rows), truth, errors, 1e-7)


@EVERY
def test_turning_there_and_back_changes_nothing(errors: SensorErrors) -> None:
    state, _ = noisy(errors)
    one, other = body_at(state, errors), body_at(nearby(state, errors), errors)
    there, twice = motion_then_to_now(one, other), motion_then_to_now(one, one)
    assert np.abs(there - np.eye(one.features)).max() > 0.01
    np.testing.assert_allclose(twice, np.eye(one.features), atol=1e-8)  # but for the faint prior of fusions


def test_noisy_rows_turned_a_little_are_nearly_exact() -> None:
    state, rows = noisy(EXACT)
    projected = ProjectedMoments.of(rows, body_at(nearby(state, EXACT, 1e-3)))
    assert_same(projected, RowMoments.of(rows), state, EXACT, 1e-3)


@EVERY
def test_they_add_up(errors: SensorErrors) -> None:
    state, rows = noisy(errors)
    body = body_at(state, errors)
    one, other, both = (ProjectedMoments.of(part, body) for part in (rows[:9], rows[9:], rows))
    assert_same(one + other, both, state, errors, 1e-12)
    assert_same(both - other, one, state, errors, 1e-9)
    assert (both - other).body is body

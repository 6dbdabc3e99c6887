"""Which rows do not fit, and whether another load or a sensor explains them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.body import FORCING, REGRESSOR, BodyModel, load_operator, residual_covariance
from coheft.estimation.moments.misfit import WINDOWS, Explanations, KnownLoad, excess_energy, explanations, worst_misfit
from coheft.estimation.moments.moments import RowMoments, view_moments
from coheft.estimation.moments.rows import RowNoise
from tests.estimation.moments.moving_team import NOISE, Team, body_at, make_team

KNOWN: Array = 1e-4 * np.eye(10)


@given(st.integers(0, 40), st.integers(1, 3), st.integers(1, 4), st.integers(0, 1000))
def test_the_worst_stretch_is_found(number: int, sources: int, size: int, seed: int) -> None:
    residuals = np.random.default_rng(seed).normal(size=(number, sources, size))
    found = worst_misfit(residuals)
    if number == 0:
        assert found is None
        return
    stretches = {
        (first, rows, source): float(np.square(residuals[first : first + rows, source].sum(axis=0)).sum() / rows)
        for rows in WINDOWS
        for first in range(number - rows + 1)
        for source in range(sources)
    }
    assert found is not None
    worst = max(stretches, key=lambda stretch: stretches[stretch])
    assert (found.chi_square, found.source) == (pytest.approx(stretches[worst]), worst[2])


@pytest.mark.parametrize("rows", [1, 4, 16])
def test_a_constant_offset_is_found_where_it_is(rows: int) -> None:
    residuals = np.random.default_rng(1).normal(size=(100, 3, 6))
    residuals[40 : 40 + rows, 1, 2] += 30.0 / np.sqrt(rows)
    found = worst_misfit(residuals)
    assert found is not None
    assert found.source == 1
    assert found.chi_square == pytest.approx(900.0, rel=0.3)


def test_what_sensors_may_have_drifted_is_allowed_for() -> None:
    rng = np.random.default_rng(2)
    drifted = rng.normal(size=(4000, 1, 6)) + np.repeat(0.7 * rng.normal(size=(40, 1, 6)), 100, axis=0)
    alone, allowed = worst_misfit(drifted), worst_misfit(drifted, np.full((1, 6), 0.7**2))
    assert alone is not None
    assert allowed is not None
    assert alone.chi_square > 100.0
    assert allowed.chi_square < 45.0


def test_stretches_of_noise_are_chi_square() -> None:
    residuals = np.random.default_rng(2).normal(size=(4000, 1, 6))
    found = worst_misfit(residuals)
    assert found is not None
    assert 20.0 < found.chi_square < 45.0


def test_energy_counts_deviations() -> None:
    rng = np.random.default_rng(3)
    found = [excess_energy(rng.normal(size=(50, 6)), 300.0, 0.0) for _ in range(500)]
    assert np.mean(found) == pytest.approx(0.0, abs=0.2)
    assert np.std(found) == pytest.approx(1.0, abs=0.15)


def test_energy_allows_for_noise_that_is_larger_than_told() -> None:
    rng = np.random.default_rng(4)
    found = [excess_energy(np.sqrt(1.2) * rng.normal(size=(50, 6)), 300.0, 0.2) for _ in range(4000)]
    assert np.mean(found) == pytest.approx(0.0, abs=0.2)
    assert np.std(found) == pytest.approx(1.0, abs=0.05)
    assert excess_energy(np.full((50, 6), 1.5), 300.0, 0.2) > 6.0
    assert excess_energy(np.zeros((50, 6)), 300.0, 0.2) < -6.0


def explained(team: Team, rows: Array, assumed: Array, known: Array | None = None) -> Explanations:
    body = body_at(team.state())
    return explanations(body, view_moments(body, RowMoments.of(rows)), KnownLoad(assumed, known))


def least_squares(body: BodyModel, rows: Array, assumed: Array) -> tuple[float, dict[tuple[int, str], float]]:
    """By how much another load makes the sum of squares smaller, and by how much more each sensor does."""
    root = np.linalg.cholesky(np.linalg.inv(residual_covariance(body, assumed))).T
    motion, wrenches = rows @ body.motion_map[FORCING].T, rows @ body.wrench_map.T
    left = ((wrenches - motion @ load_operator(assumed).T) @ root.T).ravel()
    by_load = np.einsum("nk,kij->nij", motion, REGRESSOR)[:, :, 6:]

    def smaller(design: Array) -> float:
        flat = (root @ design).reshape(len(left), -1)
        scale = np.linalg.norm(flat, axis=0)
        return float(left @ left - np.sum((left - flat / scale @ np.linalg.lstsq(flat / scale, left)[0]) ** 2))

    alone, by_sensor = smaller(by_load), {}
    for robot, adjoint in enumerate(body.adjoints):
        for kind, part in (("force", slice(0, 3)), ("torque", slice(3, 6))):
            constant = np.broadcast_to(adjoint[:, part], (len(rows), 6, 3))
            by_sensor[robot, kind] = smaller(np.concatenate([by_load, constant], axis=2)) - alone
    return alone, by_sensor


@pytest.mark.parametrize("seed", range(3))
def test_explanations_are_those_of_least_squares(seed: int) -> None:
    team, quiet = make_team(seed), RowNoise(1e-2 * NOISE.kinematics, NOISE.wrench)
    rows = team.noisy(np.random.default_rng(seed), quiet)
    rows[:, :-1].reshape(len(rows), 3, 24)[:, 1, 12] += 2.0
    other = team.load * np.repeat([1.0, 1.1], [6, 10])
    body = body_at(team.state(), noise=quiet)
    found = explanations(body, view_moments(body, RowMoments.of(rows)), KnownLoad(other))
    by_load, by_sensor = least_squares(body, rows, other)
    assert found.load == pytest.approx(by_load - 10.0, rel=1e-3)
    # If the former load may be anything, a sensor beside it explains as much as one beside another load.
    assert by_sensor[found.robot, found.kind] == pytest.approx(max(by_sensor.values()))
    assert found.sensor == pytest.approx(by_load + max(by_sensor.values()) - 3.0, rel=1e-3)


def test_nothing_needs_to_be_explained_where_nothing_has_changed() -> None:
    for seed in range(10):
        team = make_team(seed)
        found = explained(team, team.noisy(np.random.default_rng(seed)), team.load, KNOWN)
        assert max(found.load, found.sensor) < 25.0


def test_another_load_is_told_from_a_sensor() -> None:
    team = make_team(seed=5)
    heavier = team.holding(team.load * np.repeat([1.0, 1.1], [6, 10]))
    found = explained(heavier, heavier.noisy(np.random.default_rng(6)), team.load, KNOWN)
    assert found.load > found.sensor + 100.0


def test_another_load_is_told_from_a_sensor_where_the_offset_is_uncertain() -> None:
    team = make_team(seed=5)
    heavier = team.holding(team.load * np.repeat([1.0, 1.02], [6, 10]))
    rows, assumed = heavier.noisy(np.random.default_rng(6)), team.load + np.repeat([1.0, 0.0], [3, 13])
    uncertain = np.diag(np.repeat([1.0, 0.1**2, 1e-4], [3, 3, 10]))
    found = explained(heavier, rows, assumed, uncertain)
    assert found.load > found.sensor + 25.0
    as_if_known = explained(heavier, rows, assumed, KNOWN)
    assert as_if_known.load < as_if_known.sensor


def test_a_sensor_is_told_from_another_load_where_the_offset_is_uncertain() -> None:
    team = make_team(seed=7)
    rows = team.noisy(np.random.default_rng(8))
    rows[:, :-1].reshape(len(rows), 3, 24)[:, 1, 12:15] += 3.0
    found = explained(team, rows, team.load, np.diag(np.repeat([0.1**2, 0.02**2, 1e-4], [3, 3, 10])))
    assert (found.robot, found.kind) == (1, "force")
    assert found.sensor > found.load + 25.0


@pytest.mark.parametrize("robot", [0, 2])
@pytest.mark.parametrize(("kind", "first", "size"), [("force", 12, 3.0), ("torque", 15, 1.5)])
def test_a_sensor_is_told_from_another_load(robot: int, kind: str, first: int, size: float) -> None:
    team = make_team(seed=7)
    rows = team.noisy(np.random.default_rng(8))
    rows[:, :-1].reshape(len(rows), 3, 24)[:, robot, first : first + 3] += size
    found = explained(team, rows, team.load, KNOWN)
    assert found.kind == kind
    assert found.robot == robot or kind == "torque"  # torques have no lever arm, so whose it is does not show
    assert found.sensor > found.load + 25.0

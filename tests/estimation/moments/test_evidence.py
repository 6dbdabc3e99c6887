"""Quadratics that know their noise, against dense algebra of Gaussians."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.evidence import Evidence

SIZE = 6
WIDE = np.full(SIZE, 1e3)
PART, OTHERS = np.array([1, 4]), np.array([0, 2, 3, 5])
seeds = st.integers(0, 10_000)


def definite(rng: np.random.Generator, size: int = SIZE, scale: float = 1.0) -> Array:
    root = rng.normal(size=(size, size + 3))
    return scale * (root @ root.T)


def random_evidence(seed: int, noise: float = 0.0) -> Evidence:
    rng = np.random.default_rng(seed)
    of_noise = definite(rng, scale=noise) if noise else np.zeros((SIZE, SIZE))
    return Evidence(10.0 * rng.normal(size=SIZE), definite(rng) + np.eye(SIZE), of_noise, 0.03 * of_noise)


def mean_and_covariance(evidence: Evidence) -> tuple[Array, Array]:
    solution = evidence.solve(np.full(len(evidence.score), 1e3))
    return solution.inverse @ evidence.score, solution.seen


def log_likelihood(evidence: Evidence, step: Array) -> float:
    return float(evidence.score @ step - 0.5 * step @ evidence.information @ step)


def assert_equal(one: Evidence, other: Evidence) -> None:
    for name, value in vars(other).items():
        np.testing.assert_allclose(getattr(one, name), value, rtol=1e-9, atol=1e-9, err_msg=name)


@given(seeds)
def test_likelihoods_multiply(seed: int) -> None:
    one, other = random_evidence(seed, 0.1), random_evidence(seed + 1, 0.2)
    both, step = one + other, np.random.default_rng(seed).normal(size=SIZE)
    assert log_likelihood(both, step) == pytest.approx(log_likelihood(one, step) + log_likelihood(other, step))
    np.testing.assert_allclose(both.noise, one.noise + other.noise)
    np.testing.assert_allclose(both.doubt, one.doubt + other.doubt)


@given(seeds)
def test_moved_is_the_same_quadratic_around_another_value(seed: int) -> None:
    evidence, rng = random_evidence(seed, 0.1), np.random.default_rng(seed)
    step, other = rng.normal(size=(2, SIZE))
    moved = evidence.shifted(step)
    expected = log_likelihood(evidence, step + other) - log_likelihood(evidence, step)
    assert log_likelihood(moved, other) == pytest.approx(expected, abs=1e-8)
    assert_equal(moved.shifted(-step), evidence)


def test_placed_and_of_undo_each_other() -> None:
    evidence, indices = random_evidence(1, 0.1), np.array([7, 0, 3, 9, 5, 2])
    placed = evidence.embedded(10, indices)
    assert_equal(placed.restricted(indices), evidence)
    others = np.setdiff1d(np.arange(10), indices)
    assert not placed.score[others].any()
    for matrix in (placed.information, placed.noise, placed.doubt):
        assert not matrix[others].any()
        assert not matrix[:, others].any()
    assert_equal(evidence.embedded(10, slice(2, 8)), evidence.embedded(10, np.arange(2, 8)))


@given(seeds)
def test_of_is_the_quadratic_with_all_others_held(seed: int) -> None:
    evidence, step = random_evidence(seed, 0.1), np.random.default_rng(seed).normal(size=2)
    whole = np.zeros(SIZE)
    whole[PART] = step
    assert log_likelihood(evidence.restricted(PART), step) == pytest.approx(log_likelihood(evidence, whole))


@given(seeds)
def test_without_is_the_marginal(seed: int) -> None:
    evidence = random_evidence(seed)
    marginal = evidence.marginalized(PART, WIDE[:2])
    mean, covariance = mean_and_covariance(evidence)
    found_mean, found = mean_and_covariance(marginal.restricted(OTHERS))
    np.testing.assert_allclose(found_mean, mean[OTHERS], rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(found, covariance[np.ix_(OTHERS, OTHERS)], rtol=1e-7, atol=1e-9)
    assert not marginal.score[PART].any()
    assert not marginal.information[PART].any()
    assert not marginal.information[:, PART].any()


@given(seeds)
def test_without_knows_the_covariance_of_its_score(seed: int) -> None:
    evidence = random_evidence(seed, 0.2)
    marginal, h = evidence.marginalized(PART, WIDE[:2]), evidence.information
    take = np.eye(SIZE)
    take[np.ix_(OTHERS, PART)] = -h[np.ix_(OTHERS, PART)] @ np.linalg.inv(h[np.ix_(PART, PART)])
    take = take[OTHERS]
    spread = take @ (h + evidence.noise) @ take.T
    found = (marginal.information + marginal.noise)[np.ix_(OTHERS, OTHERS)]
    np.testing.assert_allclose(found, spread, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(marginal.score[OTHERS], take @ evidence.score, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(marginal.doubt, 0.03 * marginal.noise, rtol=1e-8, atol=1e-9)


@given(seeds, st.floats(-3.0, 1.0))
def test_loosened_adds_to_the_covariance_and_keeps_the_mean(seed: int, magnitude: float) -> None:
    evidence = random_evidence(seed)
    added = definite(np.random.default_rng(seed), 2, 10.0**magnitude)
    mean, covariance = mean_and_covariance(evidence)
    covariance[np.ix_(PART, PART)] += added
    found_mean, found = mean_and_covariance(evidence.with_process_noise(PART, added))
    np.testing.assert_allclose(found, covariance, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(found_mean, mean, rtol=1e-6, atol=1e-6)


def test_loosened_twice_is_loosened_by_the_sum() -> None:
    evidence, rng = random_evidence(3, 0.2), np.random.default_rng(3)
    one, other = definite(rng, 2), definite(rng, 2)
    twice, once = (
        evidence.with_process_noise(PART, one).with_process_noise(PART, other),
        evidence.with_process_noise(PART, one + other),
    )
    assert_equal(twice, once)
    by_slice = evidence.with_process_noise(slice(2, 4), one)
    assert_equal(by_slice, evidence.with_process_noise(np.array([2, 3]), one))


def test_some_of_what_is_loosened_may_not_have_changed_at_all() -> None:
    evidence, only_one = random_evidence(5, 0.2), np.diag([0.7, 0.0])
    assert_equal(evidence.with_process_noise(PART, only_one), evidence.with_process_noise(PART[:1], only_one[:1, :1]))
    assert_equal(evidence.with_process_noise(PART, np.zeros((2, 2))), evidence)


def test_loosened_a_little_and_without_are_limits() -> None:
    evidence = random_evidence(4, 0.2)
    assert_equal(evidence.with_process_noise(PART, 1e-14 * np.eye(2)), evidence)
    far, without = evidence.with_process_noise(PART, 1e12 * np.eye(2)), evidence.marginalized(PART, WIDE[:2])
    assert_equal(far.restricted(OTHERS), without.restricted(OTHERS))
    assert np.abs(far.information[PART]).max() < 1e-9


@given(seeds)
def test_solve_gives_the_covariance_of_a_fit(seed: int) -> None:
    evidence = random_evidence(seed, 0.2)
    solution, inverse = evidence.solve(WIDE), np.linalg.inv(evidence.information)
    np.testing.assert_allclose(solution.inverse, inverse, rtol=1e-7)
    expected = inverse @ (evidence.information + evidence.noise) @ inverse
    np.testing.assert_allclose(solution.seen, expected, rtol=1e-7)
    assert not solution.hidden.any()


@given(seeds)
def test_hidden_directions_are_found_and_do_not_move(seed: int) -> None:
    rng = np.random.default_rng(seed)
    basis = rng.normal(size=(4, SIZE))  # four combinations are measured, two are not
    information = basis.T @ definite(rng, 4, 100.0) @ basis
    limits = rng.uniform(0.1, 10.0, SIZE)
    weak = Evidence.prior(100.0 * limits)
    evidence = Evidence(information @ rng.normal(size=SIZE), information, 0.0 * information, 0.0 * information) + weak
    solution = evidence.solve(limits)
    assert np.linalg.matrix_rank(solution.inverse, tol=1e-9 * float(np.abs(solution.inverse).max())) <= 4
    assert np.linalg.matrix_rank(solution.hidden, tol=1e-9 * float(np.abs(solution.hidden).max())) >= 2
    # What moves explains the measurements, and the shortest way there has been taken.
    step = solution.inverse @ evidence.score
    np.testing.assert_allclose(information @ step, evidence.score, rtol=0.05, atol=0.02 * np.abs(evidence.score).max())
    null = np.linalg.svd(basis)[2][4:]
    just_seen = np.linalg.inv(null / limits**2 @ null.T)
    assert np.linalg.eigvals(np.linalg.solve(just_seen, null @ solution.hidden @ null.T)).real.min() > 100.0


def test_what_is_hidden_is_uncertain_by_twenty_limits() -> None:
    limits = np.array([0.1, 2.0, 3.0])
    evidence = Evidence.of_information(np.diag([1e6, 1e-9, 0.0]), np.ones(3))
    solution = evidence.solve(limits)
    np.testing.assert_allclose(solution.seen, np.diag([1e-6, 0.0, 0.0]), atol=1e-15)
    np.testing.assert_allclose(solution.hidden, np.diag([0.0, 1600.0, 3600.0]), atol=1e-9)


@pytest.mark.parametrize(("information", "is_seen"), [(1.29, False), (1.31, True)])
def test_what_is_doubtful_is_not_seen(information: float, is_seen: bool) -> None:
    one = np.eye(1)
    solution = Evidence(np.ones(1), information * one, one, 0.3 * one).solve(np.ones(1))
    assert bool(solution.seen.any()) == is_seen
    assert bool(solution.hidden.any()) != is_seen


def test_a_prior_shows_what_noisy_rows_leave_in_doubt() -> None:
    noise = np.diag([0.0, 100.0])
    rows = Evidence(np.array([50.0, 3.0]), np.diag([50.0, 5.0]), noise, 0.3 * noise)
    prior, limits = Evidence.of_information(np.diag([0.0, 20.0])), np.ones(2)
    assert (rows + prior).solve(limits).hidden[1, 1] > 100.0
    solution = (rows.beyond_doubt(limits) + prior).solve(limits)
    assert not solution.hidden.any()
    np.testing.assert_allclose(solution.seen, np.diag([1 / 50, 1 / 20]), atol=1e-12)


@given(seeds)
def test_what_is_beyond_doubt_does_not_depend_on_coordinates(seed: int) -> None:
    rng, ones = np.random.default_rng(seed), np.ones(SIZE)
    noise = definite(rng, scale=100.0)
    evidence = Evidence(rng.normal(size=SIZE), definite(rng, scale=100.0), noise, 0.3 * noise)
    turn = np.linalg.qr(rng.normal(size=(SIZE, SIZE)))[0]

    def turned(each: Evidence) -> Evidence:
        parts = (turn @ part @ turn.T for part in (each.information, each.noise, each.doubt))
        return Evidence(turn @ each.score, *parts)

    kept = evidence.beyond_doubt(ones)
    assert_equal(turned(evidence).beyond_doubt(ones), turned(kept))
    assert np.linalg.eigvalsh(kept.information - kept.doubt)[0] > -1e-8
    assert_equal(kept.beyond_doubt(ones), kept)


@given(seeds)
def test_evidence_without_noise_is_beyond_doubt(seed: int) -> None:
    assert_equal(random_evidence(seed).beyond_doubt(WIDE), random_evidence(seed))


def test_doubt_shrinks_with_rows() -> None:
    def share(count: float) -> float:
        return float(Evidence.of_rows(np.zeros(2), np.eye(2), np.eye(2), count).doubt[0, 0])

    assert share(0.0) == share(1.0) > share(100.0) > share(1e9) > 0.1


def test_a_prior_pulls_towards_its_mean() -> None:
    deviations, error = np.array([0.1, 2.0, np.inf]), np.array([1.0, -2.0, 3.0])
    prior = Evidence.prior(deviations, error)
    np.testing.assert_allclose(prior.information, np.diag([100.0, 0.25, 0.0]))
    np.testing.assert_allclose(prior.score, [100.0, -0.5, 0.0])
    assert not Evidence.prior(deviations).score.any()
    information = definite(np.random.default_rng(1), 3)
    mean, covariance = mean_and_covariance(Evidence.of_information(information, error))
    np.testing.assert_allclose(mean, error)
    np.testing.assert_allclose(covariance, np.linalg.inv(information))

"""Windows that notice load changes: where, how soon, and never without reason."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from coheft.estimation.load_change import LoadWindow
from tests.estimation.load_run import BLOCK, RATE, Run


@pytest.mark.parametrize(("mass", "blocks"), [(6.0, 3), (-6.0, 3), (1.0, 40), (0.2, 200)])
def test_a_change_is_found_soon_at_its_block_and_older_blocks_are_forgotten(mass: float, blocks: int) -> None:
    run = Run(seed=1, duration=24.0)
    other = run.theta + np.sign(mass) * run.dropped(abs(mass)) if mass > 0 else run.theta
    before = run.theta if mass > 0 else run.theta + run.dropped(-mass)
    change_at = 240
    old, new = run.grams(before)[:change_at], run.grams(other)[change_at:]
    window = LoadWindow()
    changes = run.feed(window, np.concatenate([old, new]))
    assert len(changes) == 1
    assert change_at <= changes[0].last_block < change_at + blocks
    assert abs(changes[0].first_block - change_at) <= blocks // 10
    fresh = LoadWindow()
    run.feed(fresh, np.concatenate([old, new])[changes[0].first_block :], changes[0].first_block)
    np.testing.assert_allclose(run.estimate(window), run.estimate(fresh), rtol=1e-6, atol=1e-8)


def test_of_several_loads_in_a_row_only_the_last_is_left() -> None:
    """As when early samples come in, or a sensor is off for a while: all have to be told apart in one review."""
    run = Run(seed=2, duration=4.0)
    parts = [run.theta, run.theta + run.dropped(6.0), run.theta + run.dropped(2.0)]
    borders = [0, 40, 60, 70]
    window = LoadWindow(every=2)
    for first, last, theta in zip(borders, borders[1:], parts, strict=False):
        for block, gram in enumerate(run.grams(theta)[first:last], start=first):
            window.push(block, gram)
    changes = [window.review(run.model) for _ in range(2)]
    assert [change for change in changes if change is not None] == [60]
    assert window.first_block == 60


@pytest.mark.parametrize("at_rest_until", [0.0, 10.0])
def test_one_load_is_one_load_even_if_it_rests_for_long(at_rest_until: float) -> None:
    for seed in range(3):
        run = Run(seed, duration=25.0, at_rest_until=at_rest_until)
        window = LoadWindow()
        assert run.feed(window, run.grams(run.theta)) == []
        assert window.first_block == 0


def test_statistics_are_chi_square_if_nothing_changes() -> None:
    total, runs = 0.0, 40
    for seed in range(runs):
        run = Run(seed, duration=4.0)
        window = LoadWindow()
        for block, gram in enumerate(run.grams(run.theta)):
            window.push(block, gram)
        total += window.statistics(run.model)[10]
    low, high = chi2.ppf([0.001, 0.999], 10 * runs)
    assert low < total < high


def test_forgetting_what_neighbours_say_leaves_the_blocks_from_there_on() -> None:
    run = Run(seed=3, duration=4.0)
    grams = run.grams(run.theta)
    window, fresh = LoadWindow(), LoadWindow()
    run.feed(window, grams)
    window.forget_before(72)
    window.forget_before(50)
    run.feed(fresh, grams[72:], first=72)
    assert window.first_block == 72
    np.testing.assert_allclose(run.estimate(window), run.estimate(fresh), rtol=1e-9)
    window.forget_before(1000)
    assert not window.information(run.model).matrix.any()
    window.push(1000, grams[0])
    assert window.first_block == 1000
    assert window.information(run.model).count == BLOCK


def test_missing_blocks_are_no_matter() -> None:
    run = Run(seed=4, duration=10.0)
    grams = np.concatenate([run.grams(run.theta)[:100], run.grams(run.theta + run.dropped(6.0))[100:]])
    window = LoadWindow()
    found = []
    for block, gram in enumerate(grams):
        if 95 <= block < 105 or block % 7 == 0:
            continue
        window.push(block, gram)
        change = window.review(run.model)
        found += [] if change is None else [change]
    assert found == [106]


@pytest.mark.parametrize("seed", range(6))
def test_a_disturbance_that_is_expected_is_no_change_and_a_change_is_found_beside_it(seed: int) -> None:
    run = Run(seed, duration=14.0)
    change_at, size = 200, 0.4
    run.model.expect_disturbance(run.model.residual_covariance)
    grams = np.concatenate([run.grams(run.theta)[:change_at], run.grams(run.theta + run.dropped(6.0))[change_at:]])
    disturbed = grams + run.disturbances(size)
    expected = np.concatenate([disturbed, np.full((len(grams), 1), BLOCK * size)], axis=1)
    trusting, expecting = LoadWindow(), LoadWindow(riders=1, coherence=0.5 * RATE)
    assert run.feed(trusting, disturbed[:change_at])
    assert not run.feed(expecting, expected[:change_at])
    changes = run.feed(expecting, expected[change_at:], change_at)
    assert [change.first_block for change in changes] == [change_at]
    assert changes[0].last_block < change_at + 10


def test_a_short_other_beginning_does_not_hide_behind_disturbances_of_all_that_follows() -> None:
    """Nobody may have tested it while it was new: it has to stand out as well later."""
    run = Run(seed=5, duration=4.0)
    run.model.expect_disturbance(run.model.residual_covariance)
    grams = np.concatenate([run.grams(run.theta + run.dropped(0.5))[:3], run.grams(run.theta)[3:]])
    expected = np.concatenate([grams, np.full((len(grams), 1), BLOCK * 0.1)], axis=1)
    statistics = []
    window = LoadWindow(riders=1, coherence=0.5 * RATE)
    for block, gram in enumerate(expected[:40]):
        window.push(block, gram)
        if block in (4, 9, 19, 39):
            statistics.append(window.statistics(run.model).max())
    assert min(statistics) > 0.8 * statistics[0] > 150.0


def test_a_leaking_load_is_followed_and_its_estimate_called_uncertain() -> None:
    run = Run(seed=6, duration=30.0)
    time = 0.01 * np.arange(len(run.motion))
    left = 1.0 - np.clip((time - 10.0) * 0.1 / 3.0, 0.0, 1.0)
    grams = run.grams(run.theta + left[:, None] * run.dropped(3.0))
    window = LoadWindow()
    errors, deviations, flags = [], [], []
    for block, gram in enumerate(grams):
        window.push(block, gram)
        window.review(run.model)
        assert not (window.drifting and block < 200)
        if block >= 320:
            flags.append(window.drifting)
            truth = run.theta[0] + 3.0 * left[BLOCK * block + BLOCK - 1]
            information = window.information(run.model)
            inverse = np.linalg.inv(information.matrix)
            covariance = inverse @ information.score_covariance @ inverse
            errors.append(np.linalg.solve(information.matrix, information.vector)[0] - truth)
            deviations.append(np.sqrt(covariance[0, 0]))
    assert np.mean(flags) > 0.9
    assert np.sqrt(np.mean(np.square(errors))) < 0.1
    assert np.mean(np.abs(errors) < 2.0 * np.array(deviations)) > 0.9


def test_no_change_is_looked_for_before_a_border_that_was_given_up() -> None:
    run = Run(seed=3, duration=6.0)
    grams = np.concatenate([run.grams(run.theta)[:40], run.grams(run.theta + run.dropped(6.0))[40:]])
    window = LoadWindow()
    for block, gram in enumerate(grams):
        window.push(block, gram)
    window.forget_borders_before(60)
    assert window.first_block == 0
    assert window.information(run.model).count == len(run.motion)
    assert window.review(run.model) == 60


def test_blocks_from_before_are_held_against_the_load_as_well() -> None:
    run = Run(seed=6, duration=12.0)
    changed_at = 60
    thetas = np.where(np.arange(len(run.motion))[:, None] < changed_at * BLOCK, run.theta + run.dropped(1.0), run.theta)
    grams = run.grams(thetas)
    window = LoadWindow()
    # From the middle on, one new block and one old one at a time, the newest of the old ones first.
    found, middle = [], len(grams) // 2
    for k in range(middle):
        window.push(middle + k, grams[middle + k])
        if not found:
            window.push_early(middle - 1 - k, grams[middle - 1 - k])
        change = window.review(run.model)
        if change is not None:
            found.append(change)
    assert found == [pytest.approx(changed_at, abs=2)]
    np.testing.assert_allclose(run.estimate(window)[0], run.theta[0], rtol=1e-2)

"""Windows that notice load changes: where, how soon, and never without reason."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from coheft.estimation.acceleration import MotionFusion
from coheft.estimation.bounds import wrench_regressor
from coheft.estimation.forgetting_window import ForgettingWindow
from coheft.estimation.inertia import GRAM_SIZE, InertiaModel, features, packed_gram
from coheft.estimation.load_change import LoadWindow
from coheft.estimation.load_samples import LoadChange, Memory
from coheft.estimation.rigid_body import Inertia
from coheft.estimation.spatial import Array, Pose
from tests.estimation.fusion import fusion_of
from tests.estimation.team import Team, make_team

RATE, BLOCK = 100, 5
"""Samples per second, and per block: 20 blocks a second."""


class Run:
    """Blocks of a team whose load changes: what fusion makes of their sensors."""

    def __init__(self, seed: int, duration: float, at_rest_until: float = 0.0) -> None:
        self.team: Team = make_team(seed, duration=duration)
        self.fusion: MotionFusion = fusion_of(self.team)
        self.theta = self.team.inertia.barycentric()
        self.model = InertiaModel(self.fusion.wrench_covariance, self.fusion.acceleration_covariance, self.theta)
        self.motion = self.team.motion.copy()
        rest = round(100 * at_rest_until)
        self.motion[:rest] = 0.0
        self.motion[:rest, 6:9] = self.team.motion[0, 6:9]
        self._rng = np.random.default_rng(seed)

    def dropped(self, mass: float) -> Array:
        """``theta`` of a load that lies 0.3 m off."""
        place = Pose(np.eye(3), self.team.inertia.com + [0.3, 0.0, 0.0])
        return Inertia.of_box(mass, (0.1, 0.1, 0.1), place).barycentric()

    def grams(self, thetas: Array) -> Array:
        """Packed Gram matrices (n, 190) of all blocks, for ``theta`` (10,) or one for each sample (n * BLOCK, 10)."""
        bodies = np.broadcast_to(thetas, (len(self.motion), 10))
        exact = np.einsum("nij,nj->ni", wrench_regressor(self.motion), bodies)
        count, rng = len(self.motion), self._rng
        motion = self.motion.copy()
        motion[:, 6:] += rng.multivariate_normal(np.zeros(6), self.fusion.acceleration_covariance, count)
        wrench = exact + rng.multivariate_normal(np.zeros(6), self.fusion.wrench_covariance, count)
        return np.array([packed_gram(block) for block in features(motion, wrench).reshape(-1, BLOCK, 19)])

    def disturbances(self, size: float) -> Array:
        """What wrenches that swing, with so many times the noise's covariance, add to packed Gram matrices (n, 190)."""
        time = np.arange(len(self.motion)) / RATE
        frequencies, phases = self._rng.uniform(0.4, 1.6, 6), self._rng.uniform(0.0, 2.0 * np.pi, 6)
        swings = np.sqrt(2.0 * size) * np.sin(2.0 * np.pi * frequencies * time[:, None] + phases)
        wrench = swings @ np.linalg.cholesky(self.model.residual_covariance).T
        rows = features(self.motion, np.zeros((len(self.motion), 6))).reshape(-1, BLOCK, 19)
        rows_with = features(self.motion, wrench).reshape(-1, BLOCK, 19)
        return np.array([packed_gram(b) - packed_gram(a) for a, b in zip(rows, rows_with, strict=True)])

    def feed(self, memory: Memory, grams: Array, first: int = 0) -> list[LoadChange]:
        found = []
        for block, gram in enumerate(grams, start=first):
            memory.push(block, gram)
            change = memory.review(self.model)
            if change is not None:
                found.append(change)
        return found

    def estimate(self, memory: Memory) -> Array:
        information = memory.information(self.model)
        return np.linalg.solve(information.matrix, information.vector)


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
    assert [change.first_block for change in changes if change is not None] == [60]
    assert window.first_block == 60


def test_a_young_load_is_in_doubt_as_soon_as_its_samples_disagree() -> None:
    run = Run(seed=2, duration=4.0)
    grams = np.concatenate([run.grams(run.theta)[:6], run.grams(run.theta + run.dropped(0.3))[6:7]])
    for turn in range(2):
        window = LoadWindow(every=2, turn=turn)
        assert run.feed(window, grams) == []
        assert 2.0 < window.doubt < 40.0


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


def test_borders_grow_with_the_logarithm_and_are_dense_among_the_newest() -> None:
    window = LoadWindow(resolution=8)
    counts = {}
    for block in range(4096):
        window.push(block, np.ones(GRAM_SIZE))
        counts[block + 1] = len(window.borders)
    assert counts[4096] - counts[2048] <= 10
    assert counts[4096] < 100
    ages = 4096 - window.borders
    assert ages[0] == 4096
    assert set(range(1, 17)) <= set(ages.tolist())
    assert np.all(ages[:-1] - ages[1:] <= 1 + ages[:-1] / 8)


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
        found += [change] if change else []
    assert [change.first_block for change in found] == [106]


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


def test_forgetting_follows_slowly_and_does_not_forget_what_no_longer_shows() -> None:
    run = Run(seed=7, duration=20.0)
    floor = np.repeat([0.5, 0.2, 0.2], [1, 3, 6])
    window = ForgettingWindow(20.0, floor)
    run.feed(window, run.grams(run.theta))
    run.feed(window, run.grams(run.theta + run.dropped(6.0)))
    learned = run.estimate(window)
    np.testing.assert_allclose(learned, run.theta + run.dropped(6.0), atol=0.2)

    rest = Run(seed=7, duration=60.0, at_rest_until=60.0)
    run.feed(window, rest.grams(run.theta + run.dropped(6.0)))
    information = window.information(run.model)
    np.testing.assert_allclose(run.estimate(window), learned, atol=0.2)
    deviations = np.sqrt(np.diag(np.linalg.inv(information.matrix)))
    assert np.all(deviations < 1.2 * floor)


def random_grams(count: int, riders: int) -> Array:
    """Packed Gram matrices of five samples each, with riders."""
    rng = np.random.default_rng(8)
    rows = rng.normal(size=(count, BLOCK, 19))
    rows[:, :, 0] = 1.0
    return np.array([np.concatenate([packed_gram(block), rng.normal(size=riders)]) for block in rows])


def sums_of(memory: Memory) -> Array:
    """What is summed inside, all borders (or weights)."""
    seen: list[Array] = []

    def look(sums: Array) -> Array:
        seen.append(sums.copy())
        return sums

    memory.revise(look)
    return seen[0]


def doubled(sums: Array) -> Array:
    changed: Array = sums * np.append(np.ones(GRAM_SIZE), [2.0, 2.0])
    return changed


def test_all_borders_hold_the_sums_of_what_came_after_them() -> None:
    grams = random_grams(300, riders=2)
    window, brute = LoadWindow(riders=2), {}
    for block, gram in enumerate(grams):
        window.push(block, gram)
        brute[block] = gram.copy()
        if block % 70 == 35:
            window.revise(doubled)
            brute = {k: doubled(value) for k, value in brute.items()}
        if block == 150:
            window.forget_before(80)
        if block == 220:
            before = window.borders
            window.forget_borders_before(200)
            assert window.borders[0] == before[0]
            np.testing.assert_array_equal(window.borders[1:], before[before >= 200])
        if block % 50 == 49:
            borders = window.borders
            expected = [sum(brute[k] for k in range(first, block + 1)) for first in borders]
            np.testing.assert_allclose(sums_of(window), expected, rtol=1e-9, atol=1e-9)
            np.testing.assert_array_equal(window.total, sums_of(window)[0])
    assert window.first_block == 80


def test_no_change_is_looked_for_before_a_border_that_was_given_up() -> None:
    run = Run(seed=3, duration=6.0)
    grams = np.concatenate([run.grams(run.theta)[:40], run.grams(run.theta + run.dropped(6.0))[40:]])
    window = LoadWindow()
    for block, gram in enumerate(grams):
        window.push(block, gram)
    window.forget_borders_before(60)
    assert window.first_block == 0
    assert window.information(run.model).count == len(run.motion)
    change = window.review(run.model)
    assert change is not None
    assert change.first_block == 60


def test_forgetting_revises_all_that_it_remembers() -> None:
    grams = random_grams(30, riders=2)
    window = ForgettingWindow(10.0, np.full(10, 1e3), riders=2)
    for block, gram in enumerate(grams):
        window.push(block, gram)
        if block == 14:
            window.revise(doubled)
    changed = np.array([doubled(gram) if block <= 14 else gram for block, gram in enumerate(grams)])
    age = np.arange(len(grams))[::-1, None]
    expected = [(np.exp(-power * age / 10.0) * changed).sum(axis=0) for power in (1, 2)]
    np.testing.assert_allclose(sums_of(window), expected, rtol=1e-9)
    np.testing.assert_array_equal(window.total, sums_of(window)[0])
    window.forget_before(25)
    window.forget_borders_before(25)
    np.testing.assert_array_equal(sums_of(window)[0], window.total)


def test_what_is_taken_back_was_never_there() -> None:
    run = Run(seed=5, duration=12.0)
    grams = run.grams(run.theta)
    taken_back, never = LoadWindow(), LoadWindow()
    run.feed(taken_back, grams[:200])
    taken_back.forget_since(190)
    run.feed(never, grams[:190])
    np.testing.assert_allclose(taken_back.total, never.total, rtol=1e-9)
    for window in (taken_back, never):
        run.feed(window, grams[200:], first=200)
    np.testing.assert_allclose(taken_back.total, never.total, rtol=1e-9)
    np.testing.assert_allclose(run.estimate(taken_back), run.estimate(never), rtol=1e-6)


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
    assert [change.first_block for change in found] == [pytest.approx(changed_at, abs=2)]
    np.testing.assert_allclose(run.estimate(window)[0], run.theta[0], rtol=1e-2)


def test_early_blocks_count_as_if_they_had_come_in_time() -> None:
    run = Run(seed=7, duration=8.0)
    grams = run.grams(run.theta)
    in_time, early = LoadWindow(), LoadWindow()
    run.feed(in_time, grams)
    run.feed(early, grams[80:], first=80)
    for block in reversed(range(80)):
        early.push_early(block, grams[block])
    assert early.first_block == 0
    np.testing.assert_allclose(early.total, in_time.total, rtol=1e-9)


def test_less_is_claimed_while_samples_disagree_though_no_change_is_certain() -> None:
    run = Run(seed=2, duration=12.0)
    old, new = run.grams(run.theta), run.grams(run.theta + run.dropped(0.3))
    window, doubts, found = LoadWindow(), [], []
    for block, gram in enumerate(np.concatenate([old[:100], new[100:]])):
        found += run.feed(window, gram[None], block)
        doubts.append(window.doubt)
    assert set(doubts[:100]) == {1.0}
    (change,) = found
    assert max(doubts[100 : change.last_block]) > 3.0
    assert doubts[change.last_block] == 1.0


def test_doubt_outlasts_samples_that_are_forgotten_without_a_change() -> None:
    run = Run(seed=2, duration=12.0)
    window = LoadWindow()
    run.feed(window, np.concatenate([run.grams(run.theta)[:60], run.grams(run.theta + run.dropped(0.03))[60:]]))
    doubt = window.doubt
    assert window.first_block == 0
    assert doubt > 2.0
    window.forget_before(20)
    assert window.doubt == doubt


@pytest.mark.parametrize("seed", range(3))
def test_covariances_cover_the_smaller_part_of_samples_that_disagree(seed: int) -> None:
    """As when a sensor is off, too little to be noticed, soon after the load was taken up."""
    run = Run(seed, duration=12.0)
    window, worst = LoadWindow(), 0.0
    for block, gram in enumerate(
        np.concatenate([run.grams(run.theta)[:60], run.grams(run.theta + run.dropped(0.03))[60:]])
    ):
        assert run.feed(window, gram[None], block) == []
        if window.doubt > 1.0:
            variances = window.doubt * np.linalg.inv(window.information(run.model).uncompensated).diagonal()
            worst = max(worst, float(np.max(np.abs(run.estimate(window) - run.theta) / np.sqrt(variances))))
    assert 0.0 < worst < 3.0

"""Exponential forgetting: it follows, and does not forget what no longer shows."""

from __future__ import annotations

import numpy as np

from coheft.estimation.forgetting_window import ForgettingWindow
from coheft.estimation.inertia import GRAM_SIZE, packed_gram
from coheft.estimation.load_samples import Memory
from coheft.estimation.spatial import Array
from tests.estimation.load_run import BLOCK, Run


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

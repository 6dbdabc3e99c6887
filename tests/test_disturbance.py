"""How much less certain a load is by what poses did to its samples."""

from __future__ import annotations

import numpy as np
import pytest

from agents.disturbance import COHERENCE, Disturbance, Uncorrected
from coheft.estimation.inertia import GRAM_SIZE, InertiaModel, features, packed_gram
from coheft.estimation.spatial import Array

RATE = 100
NOISE = np.diag([0.3, 0.3, 0.3, 0.03, 0.03, 0.03]) ** 2


@pytest.fixture
def disturbance() -> Disturbance:
    result = Disturbance(RATE)
    result.expect(2.0 * NOISE, NOISE)
    return result


@pytest.fixture
def model(disturbance: Disturbance) -> InertiaModel:
    result = InertiaModel(NOISE, 1e-6 * np.eye(6), None)
    disturbance.tell(result)
    return result


def gram(count: int) -> Array:
    """Packed Gram matrix (190,) of so many samples of the same kind."""
    motion = np.tile(np.random.default_rng(3).normal(size=(10, 12)), (count // 10, 1))
    result = packed_gram(features(motion, np.zeros((count, 6))))
    assert result.shape == (GRAM_SIZE,)
    return result


def test_new_samples_count_until_they_are_corrected(disturbance: Disturbance, model: InertiaModel) -> None:
    uncorrected = Uncorrected()
    whole = uncorrected.of_scores(disturbance, model, gram(50))
    np.testing.assert_allclose(whole, 50 * 2.0 * model.disturbance(gram(50)), rtol=1e-12)
    uncorrected.correct(50.0, 0.0, 2.0)
    assert not uncorrected.of_scores(disturbance, model, gram(50)).any()
    some = uncorrected.of_scores(disturbance, model, gram(80))
    np.testing.assert_allclose(some, 30 * 2.0 * model.disturbance(gram(30)), rtol=1e-12)
    uncorrected.begin()
    np.testing.assert_array_equal(uncorrected.of_scores(disturbance, model, gram(50)), whole)


def test_what_was_lacked_stays_and_is_not_lacked_twice(disturbance: Disturbance, model: InertiaModel) -> None:
    uncorrected = Uncorrected()
    uncorrected.correct(100.0, 20.0, 3.0)
    lacked = uncorrected.of_scores(disturbance, model, gram(100))
    np.testing.assert_allclose(lacked, 20 * 3.0 * model.disturbance(gram(20)), rtol=1e-12)
    for size in (1.0, 0.3, 0.1):  # later steps of the poses are part of the first
        uncorrected.correct(100.0, 20.0, size)
        np.testing.assert_array_equal(uncorrected.of_scores(disturbance, model, gram(100)), lacked)


def test_it_fades_with_the_samples(disturbance: Disturbance, model: InertiaModel) -> None:
    uncorrected = Uncorrected()
    uncorrected.correct(100.0, 20.0, 3.0)
    uncorrected.age(0.5)
    faded = uncorrected.of_scores(disturbance, model, gram(50))
    np.testing.assert_allclose(faded, 10 * 3.0 * model.disturbance(gram(10)), rtol=1e-12)


def test_it_does_not_keep_its_direction_for_ever(disturbance: Disturbance, model: InertiaModel) -> None:
    count = round(5 * COHERENCE * RATE)
    scores = Uncorrected().of_scores(disturbance, model, gram(count))
    np.testing.assert_allclose(scores, COHERENCE * RATE * 2.0 * model.disturbance(gram(count)), rtol=1e-12)

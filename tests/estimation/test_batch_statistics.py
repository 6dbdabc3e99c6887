"""Covariances of sums of correlated scores."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.estimation.batch.signals import low_pass
from coheft.estimation.batch.statistics import scatter_of_sum, span_length

RATE, COUNT = 20.0, 2000


@pytest.mark.parametrize(
    ("count", "unknowns", "expected"), [(81, 1, 20), (800, 10, 20), (79, 1, 19), (12, 1, 3), (400, 10, 10), (2, 1, 1)]
)
def test_there_are_some_sums_of_every_recording(count: int, unknowns: int, expected: int) -> None:
    assert span_length(count, 20.0, unknowns) == expected


@pytest.mark.parametrize(("order", "within"), [(0, 0.2), (1, 0.5)], ids=["filtered", "differentiated"])
def test_scatter_is_that_of_a_sum_of_correlated_scores(order: int, within: float) -> None:
    """Separate sums of 1 s would be 22 % too low for filtered noise, and 2.3 times too high if it is differentiated."""
    rng = np.random.default_rng(1)
    motion = np.sin(2.0 * np.pi * 0.4 * np.arange(COUNT) / RATE)
    sums, scatters = [], []
    for _ in range(400):
        noise = np.diff(low_pass(rng.normal(size=COUNT + 1 + order), RATE, 3.0), order)[:COUNT]
        scores = (motion * noise)[:, None]
        sums.append(float(scores.sum()))
        scatters.append(float(scatter_of_sum(scores, RATE, 1)[0, 0]))
    assert np.mean(scatters) == pytest.approx(np.var(sums), rel=within)


def test_squared_error_is_one_per_component_even_if_few_sums_say_how_large_it_is() -> None:
    """A regression with motion that comes in bursts: fewer sums count than there are, and residuals are fitted."""
    rng = np.random.default_rng(2)
    sizes = np.repeat(rng.uniform(0.2, 2.0, size=60), 20)[:, None]
    squares = []
    for _ in range(400):
        regressor, noise = sizes * rng.normal(size=(len(sizes), 10)), rng.normal(size=len(sizes))
        matrix = regressor.T @ regressor
        error = np.linalg.solve(matrix, regressor.T @ noise)
        scatter = scatter_of_sum(regressor * (noise - regressor @ error)[:, None], RATE, 10)
        squares.append(float(error @ matrix @ np.linalg.solve(scatter, matrix @ error)) / 10.0)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.15)


def test_scores_that_are_all_zero_have_no_scatter() -> None:
    assert not scatter_of_sum(np.zeros((100, 3)), RATE, 3).any()

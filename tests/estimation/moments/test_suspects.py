"""What has changed: ratios of Gaussian densities, with how far what changes may move as a prior."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.evidence import Evidence
from coheft.estimation.moments.fit_settings import Guess
from coheft.estimation.moments.suspects import SLIP, LogRatios, log_ratios
from tests.estimation.moments.fitting import IDEAL
from tests.estimation.moments.moving_team import make_team

TEAM = make_team(1)
BODY = IDEAL.body(TEAM.state())
GUESS = Guess.about(TEAM.load[6:], 0.5)
PLACES = np.concatenate([BODY.unknowns.poses.ravel(), np.arange(BODY.unknowns.size)[BODY.unknowns.load]])


def spread(seed: int, scales: Array) -> Array:
    """A random covariance with standard deviations of about these scales."""
    root = np.random.default_rng(seed).normal(size=(len(scales), 2 * len(scales))) * scales[:, None]
    return root @ root.T / (2 * len(scales))


def scales() -> Array:
    """How far each unknown may be off."""
    result = np.ones(BODY.unknowns.size)
    result[BODY.unknowns.poses], result[BODY.unknowns.theta] = 0.1 * SLIP, 0.01 * GUESS.limits
    return result


def log_density(score: Array, covariance: Array) -> float:
    return -0.5 * float(score @ np.linalg.solve(covariance, score) + np.linalg.slogdet(covariance)[1])


def test_each_ratio_is_that_of_two_densities_of_the_score() -> None:
    information, covariance = np.linalg.inv(spread(1, scales())), spread(2, scales())
    step = np.zeros(BODY.unknowns.size)
    step[BODY.unknowns.poses[1]] = 0.7 * SLIP
    zero = np.zeros_like(information)
    newest = Evidence(information @ step, information, zero, zero)
    found = log_ratios(BODY, newest, covariance, GUESS)

    of_places = information[PLACES]
    unchanged = of_places[:, PLACES] + of_places @ covariance @ of_places.T

    def expected(indices: Array, deviations: Array) -> float:
        moved = of_places[:, indices] * deviations
        score = newest.score[PLACES]
        densities = [log_density(score, unchanged + share**2 * moved @ moved.T) for share in (1.0, 0.1, 0.01)]
        return max(densities) - log_density(score, unchanged)

    assert found.slips[1] == max(found.slips) > max(found.load, found.sensor)
    for robot, own in enumerate(BODY.unknowns.poses):
        assert found.slips[robot] == pytest.approx(expected(own, SLIP), rel=1e-6, abs=1e-6)
    theta = np.arange(BODY.unknowns.size)[BODY.unknowns.theta]
    assert found.load == pytest.approx(expected(theta, GUESS.limits), rel=1e-6, abs=1e-6)


def test_a_slip_with_another_load_is_told_from_either_alone() -> None:
    information, covariance = np.linalg.inv(spread(1, scales())), spread(2, scales())
    slip, load = np.zeros((2, BODY.unknowns.size))
    slip[BODY.unknowns.poses[1]], load[BODY.unknowns.theta] = 0.7 * SLIP, 0.5 * GUESS.limits
    zero = np.zeros_like(information)

    def found(step: Array) -> LogRatios:
        return log_ratios(BODY, Evidence(information @ step, information, zero, zero), covariance, GUESS)

    both = found(slip + load)
    assert np.argmax(both.slips_with_load) == 1
    assert max(both.slips_with_load) > max(both.load, both.sensor, *both.slips) + 10.0
    assert max(found(load).slips_with_load) < found(load).load
    assert max(found(slip).slips_with_load) < max(found(slip).slips)


def test_directions_that_are_noise_alone_count_for_nothing() -> None:
    information, noise = np.linalg.inv(spread(1, scales())), np.zeros((BODY.unknowns.size,) * 2)
    hidden = BODY.unknowns.theta.start
    noise[hidden, hidden] = information[hidden, hidden]
    information[hidden], information[:, hidden] = 0.0, 0.0
    score = np.zeros(BODY.unknowns.size)
    score[hidden] = 1e6
    found = log_ratios(BODY, Evidence(score, information, noise, noise), spread(2, scales()), GUESS)
    assert max(found.load, found.sensor, *found.slips) < 0.0

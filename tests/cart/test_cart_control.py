"""Trajectories, the regulator, and a cart that follows where everything is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from coheft.estimation.cart.control import Tracker, Tracking, regulator
from coheft.estimation.cart.filter import move
from coheft.estimation.cart.model import CartBody
from coheft.estimation.cart.trajectory import CURVES, STRAIGHT, TRAJECTORIES, Trajectory

BODY = CartBody(20.0, (0.3, 0.15), 2.0, (5.0, 5.0))


@pytest.mark.parametrize("name", sorted(TRAJECTORIES))
def test_targets_are_each_others_derivatives(name: str) -> None:
    trajectory, step = TRAJECTORIES[name], 1e-3
    for time in np.arange(0.3, 29.7, 0.37):
        before, here, after = (trajectory.at(float(t)) for t in (time - step, time, time + step))
        rates = (after.pose - before.pose) / (2 * step)
        c, s = np.cos(here.pose[2]), np.sin(here.pose[2])
        np.testing.assert_allclose(rates, [c * here.speed, s * here.speed, here.turn_rate], atol=2e-3)
        if before.acceleration == after.acceleration:
            assert (after.speed - before.speed) / (2 * step) == pytest.approx(here.acceleration, abs=1e-9)


def test_curves_begin_when_the_paper_says() -> None:
    for begin in (7.0, 16.0, 25.0):
        assert CURVES.at(begin - 0.01).turn_rate == 0.0
        assert CURVES.at(begin + 0.01).turn_rate != 0.0
    assert STRAIGHT.at(29.0).pose[1] == 0.0


def test_from_its_last_knot_on_a_trajectory_rests() -> None:
    """Where the last knots have speed, too: a target that stood still with a speed would be followed nowhere."""
    trajectory = Trajectory(((0.0, 2.0), (10.0, 2.0)), ((0.0, 0.0), (12.0, 0.0)))
    assert trajectory.at(11.0).pose[0] == pytest.approx(22.0)
    assert trajectory.at(11.0).speed == 2.0
    for time in (12.0, 15.0, 40.0):
        target = trajectory.at(time)
        np.testing.assert_allclose(target.pose, [24.0, 0.0, 0.0], atol=1e-9)
        assert (target.speed, target.turn_rate, target.acceleration, target.turn_acceleration) == (0.0,) * 4


def test_the_regulator_minimises_its_cost() -> None:
    alpha, weights = 0.7, (2.0, 0.5)

    def cost(gains: np.ndarray) -> float:  # type: ignore[type-arg]
        closed = np.array([[-alpha, 1.0], [-gains[0], -gains[1]]])
        times = np.linspace(0.0, 60.0, 6001)
        step, state, total = expm(closed * 0.01), np.array([1.0, -0.3]), 0.0
        for _ in times:
            total += float(state**2 @ weights + (gains @ state) ** 2) * 0.01
            state = step @ state
        return total

    best = regulator(alpha, weights)
    least = cost(best)
    for direction in np.eye(2):
        assert least < cost(best + 0.1 * direction)
        assert least < cost(best - 0.1 * direction)


@pytest.mark.parametrize(
    ("start", "limit"),
    [
        ((0.0, 0.0, 0.0), 5e-3),
        ((0.0, 0.3, 0.0), 5e-3),
        ((-0.3, -0.2, 0.3), 2e-2),
    ],
)
def test_a_known_cart_comes_to_the_path_and_stays(start: tuple[float, float, float], limit: float) -> None:
    """Also from aside, where no push helps at once."""
    tracker, period = Tracker(Tracking()), 0.005
    state = np.concatenate([start, np.zeros(3), BODY.parameters])
    for step in range(round(20.0 / period)):
        wrench_b = tracker.push(CURVES.at(step * period), state[:6], BODY)
        assert wrench_b[1] == 0.0
        state = move(state, wrench_b, period)
    assert np.hypot(*(state[:2] - CURVES.at(20.0).pose[:2])) < limit


def test_backwards_it_steers_the_other_way() -> None:
    """A cart that is pulled back and is off to the left has to turn its front to the left to come back to the path."""
    back = Trajectory(((0.0, -1.0), (30.0, -1.0)))
    ahead = Trajectory(((0.0, 1.0), (30.0, 1.0)))
    tracker = Tracker(Tracking())
    for trajectory, sign in ((ahead, -1.0), (back, 1.0)):
        target = trajectory.at(1.0)
        motion = np.array([target.pose[0], 0.1, 0.0, target.speed, 0.0, 0.0])
        centred = CartBody(20.0, (0.3, 0.0), 2.0, (5.0, 5.0))
        assert np.sign(tracker.push(target, motion, centred)[2]) == sign

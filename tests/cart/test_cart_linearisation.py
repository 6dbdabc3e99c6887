"""Analytic derivatives against finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from coheft.estimation.cart.filter import Belief, MotionMeasurement, Push, predict, update
from coheft.estimation.cart.linearisation import STATE_SIZE, linearise
from coheft.estimation.cart.model import CartBody, wheel_row
from coheft.estimation.geometry.spatial import Array
from tests.cart.carts import angles, bodies, differences, vectors


@given(bodies, angles, vectors(3, 2.0), vectors(3, 50.0))
def test_the_derivatives_of_the_dynamics(body: CartBody, theta: float, rates: Array, wrench_b: Array) -> None:
    """Also where wheels slip, as the filter's states do a little."""
    state = np.concatenate([[1.0, -2.0, theta], rates, body.parameters])
    found = linearise(state, wrench_b)
    by_state = differences(lambda x: linearise(x, wrench_b).rate, state)
    by_wrench = differences(lambda u: linearise(state, u).rate, wrench_b)
    np.testing.assert_allclose(found.by_state, by_state, atol=1e-5 * (1.0 + np.abs(by_state).max()))
    np.testing.assert_allclose(found.by_wrench, by_wrench, atol=1e-7 * (1.0 + np.abs(by_wrench).max()))


@given(bodies, angles, vectors(3, 2.0), vectors(3, 50.0))
def test_one_step_is_of_second_order(body: CartBody, theta: float, rates: Array, wrench_b: Array) -> None:
    """Two half steps differ from a whole one by a share of the third power of its duration."""
    state = np.concatenate([[1.0, -2.0, theta], rates, body.parameters])

    def after(duration: float, steps: int) -> Array:
        belief = Belief(state, np.zeros((STATE_SIZE, STATE_SIZE)))
        for _ in range(steps):
            push = Push(wrench_b, np.zeros((3, 3)), duration / steps, wrench_b)
            belief = predict(belief, push, np.zeros((6, 6)), belief.mean).belief
        return belief.mean

    def error(duration: float) -> float:
        return float(np.abs(after(duration, 1) - after(duration, 2)).max())

    assert error(0.002) < error(0.004) / 5.0 + 1e-12


@given(bodies, angles, vectors(3, 2.0), vectors(3, 50.0))
def test_the_derivative_of_one_step(body: CartBody, theta: float, rates: Array, wrench_b: Array) -> None:
    state = np.concatenate([[1.0, -2.0, theta], rates, body.parameters])
    push = Push(wrench_b, np.zeros((3, 3)), 0.01, wrench_b)
    none = np.zeros((STATE_SIZE, STATE_SIZE))

    def step(x: Array) -> Array:
        return predict(Belief(x, none), push, np.zeros((6, 6)), x).belief.mean

    found = predict(Belief(state, none), push, np.zeros((6, 6)), state).transition
    # The transition leaves out how F itself depends on the state: a share of the step squared, (F dt)^2.
    scale = np.abs(linearise(state, wrench_b).by_state).max()
    np.testing.assert_allclose(found, differences(step, state), atol=1e-3 * (1.0 + scale) + 1e-4 * scale**2)


def test_a_step_about_another_point_is_the_tangent_there() -> None:
    state = np.concatenate([[0.0, 0.0, 0.2, 1.0, 0.2, 0.3], CartBody(20.0, (0.3, 0.1), 2.0, (5.0, 4.0)).parameters])
    moved = state + np.linspace(-0.1, 0.2, STATE_SIZE)
    none = np.zeros((STATE_SIZE, STATE_SIZE))
    planned, measured = np.array([20.0, 1.0, -2.0]), np.array([24.0, -3.0, 1.0])

    def after(mean: Array, wrench_b: Array) -> Array:
        push = Push(wrench_b, np.zeros((3, 3)), 0.01, planned)
        return predict(Belief(mean, none), push, np.zeros((6, 6)), state).belief.mean

    middle = 0.5 * (after(state, planned) + after(moved, measured))
    np.testing.assert_allclose(after(0.5 * (state + moved), 0.5 * (planned + measured)), middle, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_the_update_is_least_squares_and_josephs_form_holds(seed: int) -> None:
    """Mean and covariance as from the normal equations of prior, measurement and wheels."""
    rng = np.random.default_rng(seed)
    state = np.concatenate([[0.0, 0.0, 0.2, 1.0, 0.2, 0.3], CartBody(20.0, (0.3, 0.1), 2.0, (5.0, 4.0)).parameters])
    root = rng.standard_normal((STATE_SIZE, STATE_SIZE))
    prior = Belief(state, root @ root.T)
    measurement = MotionMeasurement(state[:6] + 0.1 * rng.standard_normal(6), 0.01 * np.eye(6))
    done = update(prior, measurement, 0.05, state, corrects_cart=True).belief

    def wheels(x: Array) -> Array:
        return wheel_row(float(x[2])) @ x[3:6]

    by_wheels = differences(wheels, state)
    by_state = np.vstack([np.eye(6, STATE_SIZE), by_wheels])
    certainty = np.diag([100.0] * 6 + [400.0])
    information = np.linalg.inv(prior.covariance) + by_state.T @ certainty @ by_state
    innovation = np.append(measurement.motion - state[:6], -wheels(state))
    expected = state + np.linalg.solve(information, by_state.T @ certainty @ innovation)
    np.testing.assert_allclose(done.mean, expected, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(done.covariance, np.linalg.inv(information), rtol=1e-4, atol=1e-6)


def test_parameters_that_are_only_considered_stay_and_keep_their_covariance() -> None:
    state = np.concatenate([[0.0, 0.0, 0.2, 1.0, 0.2, 0.3], CartBody(20.0, (0.3, 0.1), 2.0, (5.0, 4.0)).parameters])
    root = np.random.default_rng(1).standard_normal((STATE_SIZE, STATE_SIZE))
    prior = Belief(state, root @ root.T)
    measurement = MotionMeasurement(state[:6] + 0.1, 0.01 * np.eye(6))
    done = update(prior, measurement, 0.05, state, corrects_cart=False).belief
    np.testing.assert_array_equal(done.mean[6:], state[6:])
    np.testing.assert_allclose(done.covariance[6:, 6:], prior.covariance[6:, 6:], atol=1e-12)
    assert np.linalg.eigvalsh(done.covariance).min() > 0.0
    assert (np.diag(done.covariance)[:6] < np.diag(prior.covariance)[:6]).all()

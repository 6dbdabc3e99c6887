"""The cart's dynamics against its energy, against each other, and against what wheels forbid."""

from __future__ import annotations

from math import cos, sin

import numpy as np
import pytest
from hypothesis import given

from coheft.estimation.cart.contact import MOVING
from coheft.estimation.cart.model import (
    CartBody,
    axes,
    forward_dynamics,
    inverse_dynamics,
    mass_matrix,
    regressor,
    resistance,
    wheel_row,
    wheel_row_derivative,
)
from coheft.estimation.geometry.spatial import Array
from tests.cart.carts import angles, bodies, vectors


def kinetic_energy(body: CartBody, theta: float, rates: Array) -> float:
    """Aguilera et al., eq. (1)."""
    m, (dx, dy) = body.mass, body.com
    x, y, turn = rates
    s, c = sin(theta), cos(theta)
    return float(
        0.5 * m * (x * x + y * y)
        - m * dx * turn * (x * s - y * c)
        - m * dy * turn * (x * c + y * s)
        + 0.5 * m * turn**2 * (dx * dx + dy * dy)
        + 0.5 * body.inertia * turn**2
    )


@given(bodies)
def test_a_body_comes_back_from_its_phi(body: CartBody) -> None:
    back = CartBody.of(body.phi, body.friction)
    np.testing.assert_allclose([back.mass, *back.com, back.inertia], [body.mass, *body.com, body.inertia], atol=1e-9)


@given(bodies)
def test_the_derivative_of_phi(body: CartBody) -> None:
    numbers = np.array([body.mass, *body.com, body.inertia])

    def phi(values: Array) -> Array:
        return CartBody(values[0], (values[1], values[2]), values[3], (0.0, 0.0)).phi

    steps = 1e-5 * np.eye(4)
    expected = np.array([(phi(numbers + step) - phi(numbers - step)) / 2e-5 for step in steps]).T
    np.testing.assert_allclose(body.phi_derivative(), expected, atol=1e-6)


@given(bodies, angles, vectors(3, 3.0))
def test_the_mass_matrix_gives_the_kinetic_energy(body: CartBody, theta: float, rates: Array) -> None:
    energy = 0.5 * rates @ mass_matrix(body.phi, theta) @ rates
    assert energy == pytest.approx(kinetic_energy(body, theta, rates), abs=1e-9)


@given(bodies, angles, vectors(3, 3.0), vectors(3, 3.0))
def test_the_dynamics_are_those_of_lagrange(body: CartBody, theta: float, rates: Array, accelerations: Array) -> None:
    """``d/dt (dT/dqd) - dT/dq``, by finite differences, is ``M qdd + C qd``."""
    step = 1e-5

    def momentum(time: float) -> Array:
        moved = rates + accelerations * time
        return mass_matrix(body.phi, theta + rates[2] * time + 0.5 * accelerations[2] * time**2) @ moved

    by_time = (momentum(step) - momentum(-step)) / (2 * step)
    by_theta = (kinetic_energy(body, theta + step, rates) - kinetic_energy(body, theta - step, rates)) / (2 * step)
    expected = by_time - np.array([0.0, 0.0, by_theta])
    np.testing.assert_allclose(regressor(theta, rates, accelerations) @ body.phi, expected, atol=1e-5)


@given(bodies, angles, vectors(3, 3.0))
def test_the_mass_matrix_and_the_regressor_agree(body: CartBody, theta: float, accelerations: Array) -> None:
    expected = mass_matrix(body.phi, theta) @ accelerations
    np.testing.assert_allclose(regressor(theta, np.zeros(3), accelerations) @ body.phi, expected, atol=1e-9)


def admissible(theta: float, parameters: Array) -> Array:
    """Rates, from ahead and turning (2,), that do not make the wheels slip."""
    rates: Array = axes(theta)[:, MOVING] @ parameters
    return rates


@given(bodies, angles, vectors(2, 2.0), vectors(3, 50.0))
def test_forward_dynamics_are_the_projected_ones(
    body: CartBody, theta: float, parameters: Array, wrench_b: Array
) -> None:
    """Eq. (9) with the rate of the constraint: ``M^-1 P (Gamma - C qd - N) - M^-1 L^T (L M^-1 L^T)^-1 L' qd``."""
    rates, row = admissible(theta, parameters), wheel_row(theta)
    inverse = np.linalg.inv(mass_matrix(body.phi, theta))
    projection = np.eye(3) - np.outer(row, row @ inverse) / (row @ inverse @ row)
    np.testing.assert_allclose(projection @ projection, projection, atol=1e-9)
    by_motion = regressor(theta, rates, np.zeros(3)) @ body.phi + resistance(body.friction, rates)
    gamma = axes(theta) @ wrench_b - by_motion
    bending = rates[2] * wheel_row_derivative(theta) @ rates
    expected = inverse @ projection @ gamma - inverse @ row * bending / (row @ inverse @ row)
    found = forward_dynamics(body.phi, body.friction, theta, rates, wrench_b).accelerations
    np.testing.assert_allclose(found, expected, atol=1e-7)


@given(bodies, angles, vectors(2, 2.0), vectors(3, 50.0))
def test_inverse_dynamics_find_the_wrench_but_for_what_wheels_take_up(
    body: CartBody, theta: float, parameters: Array, wrench_b: Array
) -> None:
    rates = admissible(theta, parameters)
    moved = forward_dynamics(body.phi, body.friction, theta, rates, wrench_b)
    gamma = inverse_dynamics(body.phi, body.friction, theta, rates, moved.accelerations)
    np.testing.assert_allclose((axes(theta).T @ gamma - wrench_b)[MOVING], 0.0, atol=1e-7)


@given(bodies, angles, vectors(2, 2.0), vectors(3, 50.0))
def test_wheels_do_no_work(body: CartBody, theta: float, parameters: Array, wrench_b: Array) -> None:
    """The energy grows by what hands put in, less what friction takes."""
    rates = admissible(theta, parameters)
    solution = forward_dynamics(body.phi, body.friction, theta, rates, wrench_b)
    step = 1e-6

    def energy(time: float) -> float:
        return kinetic_energy(body, theta + rates[2] * time, rates + time * solution.accelerations)

    power = rates @ axes(theta) @ wrench_b - resistance(body.friction, rates) @ rates
    assert (energy(step) - energy(-step)) / (2 * step) == pytest.approx(power, abs=1e-4 * (1.0 + abs(power)))


def test_one_axle_is_the_papers_constraint() -> None:
    np.testing.assert_allclose(wheel_row(0.3), [-sin(0.3), cos(0.3), 0.0], atol=1e-15)

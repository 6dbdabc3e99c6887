"""Steps of an extended Kalman filter for a cart's state and parameters under measured pushes.

As in Aguilera et al., eqs (8)-(20), the state is augmented by ``phi``, here also by the friction ``sigma``, because a
model with the wrong friction finds the wrong mass. Other differences: the transition is of second order in the time
step, because one of first order loses definiteness; the update has Joseph's form; the wheels' constraint is a
measurement; process noise enters through the wrench. Steps may be linearised about another point than the mean, so that
they can be repeated about a better one.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from coheft.estimation.cart.linearisation import FRICTION, PHI, POSE, RATES, STATE_SIZE, linearise
from coheft.estimation.cart.model import forward_dynamics, wheel_row, wheel_row_derivative
from coheft.estimation.geometry.spatial import Array

MOTION_SIZE = 6
"""A measurement: ``(q, qd)`` (Aguilera et al., eq. 10)."""
INNOVATION_SIZE = MOTION_SIZE + 1
"""A measurement, and the wheels' constraint."""
PARAMETERS = slice(6, 12)
_THETA = 2


@dataclass(frozen=True, eq=False)
class Belief:
    """Mean (12,) and covariance (12, 12) of ``(q, qd, phi, sigma)``."""

    mean: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class Push:
    """Total wrench of all hands during one step.

    Attributes:
        wrench_b: Measured wrench, shape (3,).
        covariance: Covariance of its noise, shape (3, 3).
        duration: Duration of the step [s].
        planned_b: Planned wrench, shape (3,), about which the dynamics are linearised: about the measured one, the
            derivatives would be correlated with its noise, which biases the mass upwards.
    """

    wrench_b: Array
    covariance: Array
    duration: float
    planned_b: Array


@dataclass(frozen=True, eq=False)
class MotionMeasurement:
    """A measurement of ``(q, qd)``, shape (6,), and the covariance of its noise, shape (6, 6)."""

    motion: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class Prediction:
    """Belief after a step, and derivative of the state after it by the state before, shape (12, 12)."""

    belief: Belief
    transition: Array


def predict(belief: Belief, push: Push, drift: Array, point: Array) -> Prediction:
    """Predict over one step (Aguilera et al., eqs 16 and 17, to second order).

    ``drift`` is the growth of the parameters' covariance (6, 6) per second; the dynamics are linearised about
    ``point``, a state (12,).
    """
    model = linearise(point, push.planned_b)
    step = model.by_state * push.duration
    transition = np.eye(STATE_SIZE) + step + 0.5 * step @ step
    by_wrench = push.duration * (model.by_wrench + 0.5 * step @ model.by_wrench)
    mean = point + push.duration * (model.rate + 0.5 * step @ model.rate)
    mean += transition @ (belief.mean - point) + by_wrench @ (push.wrench_b - push.planned_b)
    covariance = transition @ belief.covariance @ transition.T + by_wrench @ push.covariance @ by_wrench.T
    covariance[PARAMETERS, PARAMETERS] += push.duration * drift
    return Prediction(Belief(mean, covariance), transition)


def move(state: Array, wrench_b: Array, duration: float) -> Array:
    """The state (12,) after a step of ``duration`` [s] at constant acceleration, without its covariance."""
    solution = forward_dynamics(state[PHI], state[FRICTION], float(state[_THETA]), state[RATES], wrench_b)
    accelerations = solution.accelerations
    result = state.copy()
    result[POSE] += duration * (state[RATES] + 0.5 * duration * accelerations)
    result[RATES] += duration * accelerations
    return result


def ahead(state: Array, wrenches_b: Iterable[Array], duration: float) -> Array:
    """``(q, qd)`` (6,) after steps from a state (12,) with these wrenches, of ``duration`` [s] each."""
    for wrench_b in wrenches_b:
        state = move(state, wrench_b, duration)
    return state[:MOTION_SIZE].copy()


@dataclass(frozen=True, eq=False)
class Update:
    """Result of a measurement.

    Attributes:
        surprise: Its squared normalised innovation: chi-square distributed with ``INNOVATION_SIZE`` degrees of freedom.
        innovation: Innovation of the motion, each component in its own standard deviations, shape (6,).
        rest: ``I - K H``, shape (12, 12).
        pull: ``H^T S^-1`` times the innovation, shape (12,), for ``smooth``.
    """

    belief: Belief
    surprise: float
    innovation: Array
    rest: Array
    pull: Array


def update(belief: Belief, measurement: MotionMeasurement, slip: float, point: Array, *, corrects_cart: bool) -> Update:
    """Update with a measurement (Aguilera et al., eqs 18-20), and with the wheels' constraint.

    The constraint is linearised about ``point``, a state (12,); ``slip`` is the standard deviation of the wheels'
    sideways velocity [m/s]. If the cart is not to be corrected, the uncertainty of its parameters is only considered.
    """
    theta, rates = float(point[_THETA]), point[RATES]
    row = wheel_row(theta)
    by_state = np.eye(INNOVATION_SIZE, STATE_SIZE)
    by_state[MOTION_SIZE] = 0.0
    by_state[MOTION_SIZE, RATES] = row
    by_state[MOTION_SIZE, _THETA] = wheel_row_derivative(theta) @ rates
    innovation = np.append(measurement.motion, by_state[MOTION_SIZE] @ point - row @ rates) - by_state @ belief.mean
    noise = np.zeros((INNOVATION_SIZE, INNOVATION_SIZE))
    noise[:MOTION_SIZE, :MOTION_SIZE] = measurement.covariance
    noise[MOTION_SIZE, MOTION_SIZE] = slip**2
    spread = by_state @ belief.covariance @ by_state.T + noise
    certainty = np.linalg.inv(spread)
    pull = by_state.T @ (certainty @ innovation)
    surprise = float(innovation @ certainty @ innovation)
    gain = belief.covariance @ by_state.T @ certainty
    if not corrects_cart:
        gain[PARAMETERS] = 0.0
    rest = np.eye(STATE_SIZE) - gain @ by_state
    covariance = rest @ belief.covariance @ rest.T + gain @ noise @ gain.T  # Joseph: right for any gain
    updated = Belief(belief.mean + gain @ innovation, 0.5 * (covariance + covariance.T))
    return Update(
        belief=updated,
        surprise=surprise,
        innovation=(innovation / np.sqrt(np.diag(spread)))[:MOTION_SIZE],
        rest=rest,
        pull=pull,
    )


def smooth(steps: Sequence[tuple[Update, Prediction]]) -> list[Array]:
    """Smoothed states (12,) after each update, given all measurements (modified Bryson-Frazier form).

    Unlike backward filtering, it is stable: the past of a rolling cart does not follow from its present.
    """
    states = []
    costate = np.zeros(STATE_SIZE)
    for update, prediction in reversed(steps):
        costate = prediction.transition.T @ costate
        states.append(update.belief.mean - update.belief.covariance @ costate)
        costate = update.rest.T @ costate - update.pull
    return states[::-1]

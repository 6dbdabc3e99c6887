"""The cart's state and parameters from what it does under known pushes: the steps of an extended Kalman filter.

As in Aguilera et al., eqs (8)-(20): the state is augmented by ``phi``, here by the friction ``sigma`` of moving and
turning too, because a model with the wrong friction finds the wrong mass. Differences: the transition is of second
order in the time step, where one of first order loses definiteness; the update has Joseph's form; what the wheels
forbid is a measurement; noise enters through the wrench. Each step is linearised about a point that may be another than
the mean, so that a step can be done again about a better one.
"""

from __future__ import annotations

from collections.abc import Sequence
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
    """What is known of ``(q, qd, phi, sigma)``.

    Attributes:
        mean: Shape (12,).
        covariance: Shape (12, 12).
    """

    mean: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class Push:
    """What all hands did during one step.

    Attributes:
        wrench_b: As measured, shape (3,).
        covariance: Of that measurement, shape (3, 3).
        duration: [s].
        planned_b: About what it was meant to be, shape (3,). Slopes are taken there: at the measured wrench they would
            share its noise, and a cart that does not follow the noise would look heavier and heavier.
    """

    wrench_b: Array
    covariance: Array
    duration: float
    planned_b: Array


@dataclass(frozen=True, eq=False)
class Sighting:
    """One measurement.

    Attributes:
        motion: ``(q, qd)``, shape (6,).
        covariance: Of its noise, shape (6, 6).
    """

    motion: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class Prediction:
    """One step ahead.

    Attributes:
        belief: After it.
        transition: Derivative of the state after it by the one before, shape (12, 12).
    """

    belief: Belief
    transition: Array


def predict(belief: Belief, push: Push, drift: Array, point: Array) -> Prediction:
    """Predict over one step (Aguilera et al., eqs 16 and 17, to second order).

    Args:
        belief: Before.
        push: What the hands do.
        drift: How the parameters' covariance (6, 6) grows in a second.
        point: State about which the dynamics are linearised, shape (12,).
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


@dataclass(frozen=True, eq=False)
class Update:
    """What a measurement did.

    Attributes:
        belief: After it.
        surprise: Its squared normalised innovation: chi-square distributed with ``INNOVATION_SIZE`` degrees of freedom.
        innovation: Of each component of the motion, in its own standard deviations, shape (6,).
        rest: Derivative of the state after it by the one before, ``I - K H``, shape (12, 12).
        pull: ``H^T S^-1`` times the innovation, shape (12,), for ``smooth``.
    """

    belief: Belief
    surprise: float
    innovation: Array
    rest: Array
    pull: Array


def update(belief: Belief, sighting: Sighting, slip: float, point: Array, *, corrects_cart: bool) -> Update:
    """Update with a measurement (Aguilera et al., eqs 18-20), and with the wheels' constraint.

    Args:
        belief: Before.
        sighting: The measurement.
        slip: Standard deviation of the wheels' sideways velocity [m/s].
        point: State about which the wheels' constraint is linearised, shape (12,).
        corrects_cart: Whether parameters are corrected, or only considered.
    """
    theta, rates = float(point[_THETA]), point[RATES]
    row = wheel_row(theta)
    by_state = np.eye(INNOVATION_SIZE, STATE_SIZE)
    by_state[MOTION_SIZE] = 0.0
    by_state[MOTION_SIZE, RATES] = row
    by_state[MOTION_SIZE, _THETA] = wheel_row_derivative(theta) @ rates
    innovation = np.append(sighting.motion, by_state[MOTION_SIZE] @ point - row @ rates) - by_state @ belief.mean
    noise = np.zeros((INNOVATION_SIZE, INNOVATION_SIZE))
    noise[:MOTION_SIZE, :MOTION_SIZE] = sighting.covariance
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
    """States (12,) after each update, from all measurements, also the later ones (Bryson and Frazier's form).

    Unlike going back from the end, it is stable: a rolling cart forgets how it turned, so its past does not follow from
    its present.
    """
    states = []
    costate = np.zeros(STATE_SIZE)
    for update, prediction in reversed(steps):
        costate = prediction.transition.T @ costate
        states.append(update.belief.mean - update.belief.covariance @ costate)
        costate = update.rest.T @ costate - update.pull
    return states[::-1]

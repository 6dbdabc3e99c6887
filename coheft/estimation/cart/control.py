"""Which wrench makes a cart follow a trajectory: feedback linearisation with a linear quadratic regulator.

As in Aguilera et al., eqs (26)-(28), with ``r = ed + alpha e`` and ``u = C r - M K (e, r)``, which makes the error's
dynamics ``ed = r - alpha e``, ``rd = -K (e, r)``: the same for every cart, so one regulator serves them all. A cart has
two motions only, ahead and turning, so there are two errors: along the cart's heading, and of the heading. No push can
correct an error to the side at once; it turns the heading's reference toward the path.
"""

from __future__ import annotations

from math import atan, cos, sin

import msgspec
import numpy as np

from coheft.estimation.cart.model import CartBody, axes, axes_derivative, inverse_dynamics
from coheft.estimation.cart.trajectory import Target
from coheft.estimation.geometry.spatial import Array


class Tracking(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How hard errors are fought: ``alpha`` [1/s] and the weights of ``e``, ``r`` and of the effort.

    Attributes:
        alpha_along: [1/s].
        weights_along: Of ``(e [m], r [m/s])`` against 1 for [m/s²].
        alpha_heading: [1/s].
        weights_heading: Of ``(e [rad], r [rad/s])`` against 1 for [rad/s²].
        toward_path: Heading toward the path per error to the side [rad/m].
    """

    alpha_along: float = 0.5
    weights_along: tuple[float, float] = (0.08, 0.3)
    alpha_heading: float = 2.0
    weights_heading: tuple[float, float] = (4.0, 4.0)
    toward_path: float = 1.5


def regulator(alpha: float, weights: tuple[float, float]) -> Array:
    """``K`` (2,) of ``v = -K (e, r)`` that minimises the integral of ``weights (e, r)^2 + v^2``.

    For the dynamics ``ed = r - alpha e``, ``rd = v``.
    """
    from scipy.linalg import solve_continuous_are  # heavy, and every agent that reads a configuration is here

    dynamics, by_input = np.array([[-alpha, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    cost = solve_continuous_are(dynamics, by_input, np.diag(weights), np.eye(1))
    gains: Array = cost[1]
    return gains


class Tracker:
    """Computes wrenches for a cart of one axle; has no memory.

    Args:
        tracking: Its settings.
    """

    def __init__(self, tracking: Tracking) -> None:
        self._tracking = tracking
        self._along = regulator(tracking.alpha_along, tracking.weights_along)
        self._heading = regulator(tracking.alpha_heading, tracking.weights_heading)

    def push(self, target: Target, motion: Array, body: CartBody) -> Array:
        """What has to move the cart, ``wrench_b``, shape (3,); the force to the side, which moves nothing, is zero.

        Args:
            target: Where it shall be.
            motion: Where it is, ``(q, qd)``, shape (6,).
            body: What it is.
        """
        theta, rates = float(motion[2]), motion[3:]
        forward, turning = self._accelerations(target, motion)
        speed = cos(theta) * rates[0] + sin(theta) * rates[1]
        accelerations = axes(theta) @ np.array([forward, 0.0, turning])
        accelerations += rates[2] * axes_derivative(theta) @ np.array([speed, 0.0, 0.0])
        wrench_b: Array = axes(theta).T @ inverse_dynamics(body.phi, body.friction, theta, rates, accelerations)
        wrench_b[1] = 0.0
        return wrench_b

    def _accelerations(self, target: Target, motion: Array) -> tuple[float, float]:
        """Ahead [m/s²] and turning [rad/s²]: the target's, and what corrects the errors."""
        tracking = self._tracking
        theta, turn_rate = float(motion[2]), float(motion[5])
        c, s = cos(theta), sin(theta)
        speed = c * float(motion[3]) + s * float(motion[4])
        off_x, off_y, off_heading = (target.pose - motion[:3]).tolist()
        along, aside = c * off_x + s * off_y, c * off_y - s * off_x
        along_rate = target.speed * cos(off_heading) - speed + turn_rate * aside
        aside_rate = target.speed * sin(off_heading) - turn_rate * along
        forward = target.acceleration * cos(off_heading) + _correction(
            along, along_rate, tracking.alpha_along, self._along
        )
        # Where the cart heads for: along the path, and toward it, the other way round when it goes backwards.
        gain = tracking.toward_path * max(-1.0, min(1.0, target.speed / _FULL_SPEED))
        flattening = 1.0 / (1.0 + (gain * aside) ** 2)
        heading_error = off_heading + atan(gain * aside)
        heading_rate_error = target.turn_rate - turn_rate + gain * aside_rate * flattening
        turning = target.turn_acceleration + _correction(
            heading_error, heading_rate_error, tracking.alpha_heading, self._heading
        )
        return forward, turning


_FULL_SPEED = 0.5
"""Slower, an error to the side turns the heading less [m/s]."""


def _correction(error: float, rate: float, alpha: float, gains: Array) -> float:
    """``alpha ed + K (e, r)``."""
    return alpha * rate + float(gains[0]) * error + float(gains[1]) * (rate + alpha * error)

"""Trajectory tracking by feedback linearisation with a linear quadratic regulator.

As in Aguilera et al., eqs (26)-(28), with ``r = ed + alpha e`` and ``u = C r - M K (e, r)``, which makes the error's
dynamics ``ed = r - alpha e``, ``rd = -K (e, r)`` independent of the cart. Forward motion and rotation have one error
each: along the cart's heading, and of the heading. A lateral error turns the reference heading towards the path.
"""

from math import atan, cos, sin

import msgspec
import numpy as np

from coheft.estimation.cart.model import CartBody, axes, axes_derivative, inverse_dynamics
from coheft.estimation.cart.trajectory import Target
from coheft.estimation.geometry.spatial import Array


class Tracking(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings of the regulator.

    Attributes:
        alpha_along: ``alpha`` of the error along the heading [1/s].
        weights_along: Weights of ``(e [m], r [m/s])``, relative to that of the acceleration [m/s²].
        alpha_heading: ``alpha`` of the heading's error [1/s].
        weights_heading: Weights of ``(e [rad], r [rad/s])``, relative to that of the acceleration [rad/s²].
        toward_path: Change of the reference heading per lateral error [rad/m].
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
    from scipy.linalg import solve_continuous_are  # heavy, and each agent imports this module for its configuration

    dynamics, by_input = np.array([[-alpha, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    cost = solve_continuous_are(dynamics, by_input, np.diag(weights), np.eye(1))
    gains: Array = cost[1]
    return gains


class Tracker:
    """Computes wrenches that make a cart follow its targets."""

    def __init__(self, tracking: Tracking) -> None:
        self._tracking = tracking
        self._along = regulator(tracking.alpha_along, tracking.weights_along)
        self._heading = regulator(tracking.alpha_heading, tracking.weights_heading)

    def push(self, target: Target, motion: Array, body: CartBody) -> Array:
        """Total wrench ``wrench_b``, shape (3,), from the present ``(q, qd)``, shape (6,).

        Its lateral force, which moves nothing, is zero.
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
        """Forward [m/s²] and angular [rad/s²] acceleration: the target's, plus corrections of the errors."""
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
        # The reference heading is along the path and towards it; backwards, the correction has the opposite sign.
        gain = tracking.toward_path * max(-1.0, min(1.0, target.speed / _FULL_SPEED))
        flattening = 1.0 / (1.0 + (gain * aside) ** 2)
        heading_error = off_heading + atan(gain * aside)
        heading_rate_error = target.turn_rate - turn_rate + gain * aside_rate * flattening
        turning = target.turn_acceleration + _correction(
            heading_error, heading_rate_error, tracking.alpha_heading, self._heading
        )
        return forward, turning


_FULL_SPEED = 0.5
"""Speed below which a lateral error turns the heading less [m/s]."""


def _correction(error: float, rate: float, alpha: float, gains: Array) -> float:
    """``alpha ed + K (e, r)``."""
    return alpha * rate + float(gains[0]) * error + float(gains[1]) * (rate + alpha * error)

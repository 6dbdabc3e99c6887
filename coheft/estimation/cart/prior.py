"""How little is known of a cart before it is pushed, and after something has happened to it."""

from __future__ import annotations

from math import hypot

import msgspec
import numpy as np

from coheft.estimation.cart.model import CartBody
from coheft.estimation.geometry.spatial import Array


class CartPrior(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How wrong the first guess of a cart may be, and how fast and how suddenly a cart may change.

    Attributes:
        mass: Standard deviation as a share of the guess.
        com: Standard deviation per axis [m].
        inertia: Standard deviation as a share of the guess.
        friction: Standard deviations of moving and of turning friction, as shares of the guess.
        least: No cart has less mass, or moment of inertia, than this share of the guess.
        drift: Standard deviation of the change in one second, as a share of the first standard deviation.
        slip: Of the wheels, sideways [m/s].
        slow: Unless the cart is surely faster than this, parameters are not corrected: friction is not viscous [m/s].
        turning: Nor while it rolls so far after it has changed its direction: casters turn round [m].
        drag: Standard deviation of what casters do meanwhile, force [N] and torque [N·m].
        start: Standard deviation of the first velocity, from standing still [m/s, rad/s].
        load: Standard deviation of the mass that may suddenly come or go [kg].
        place: Standard deviation per axis of where it lies, from the centre of mass [m].
        size: Its radius of gyration is between none and about so much [m].
        jolt: Standard deviation of the velocity that the cart may suddenly lose or gain with it [m/s, rad/s].
    """

    mass: float = 0.6
    com: float = 0.15
    inertia: float = 0.6
    friction: tuple[float, float] = (1.0, 1.0)
    least: float = 0.25
    drift: float = 1e-4
    slip: float = 1e-3
    slow: float = 0.05
    turning: float = 0.3
    drag: tuple[float, float] = (10.0, 2.0)
    start: float = 0.02
    load: float = 10.0
    place: float = 0.2
    size: float = 0.4
    jolt: float = 0.3

    def covariance(self, guess: CartBody) -> Array:
        """Of ``(phi, sigma)`` around a guess, shape (6, 6)."""
        deviations = guess.mass * self.mass, self.com, self.com, guess.inertia * self.inertia
        derivative = guess.phi_derivative()
        result = np.zeros((6, 6))
        result[:4, :4] = derivative @ np.diag(np.square(deviations)) @ derivative.T
        result[4:, 4:] = np.diag(np.square(np.multiply(guess.friction, self.friction)))
        return result


_FARTHEST = 2.0
"""No cart's centre of mass is farther from its axle [m]."""


def nearest_possible(phi: Array, least_mass: float, least_inertia: float) -> Array:
    """``phi`` (4,) of a cart that can be: its mass and its own moment of inertia at least so much, its centre near."""
    mass = max(float(phi[0]), least_mass)
    _, x, y, turning = phi.tolist()
    far = max(1.0, hypot(x, y) / (mass * _FARTHEST))
    x, y = x / far, y / far
    return np.array([mass, x, y, max(turning, (x * x + y * y) / mass + least_inertia)])

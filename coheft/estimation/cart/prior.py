"""Prior of a cart before it is pushed, and of its changes."""

from math import hypot

import msgspec
import numpy as np

from coheft.estimation.cart.model import CartBody
from coheft.estimation.geometry.spatial import Array


class CartPrior(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Uncertainty of the first guess of a cart, and of its gradual and sudden changes.

    Attributes:
        mass: Standard deviation of the mass, relative to the guess.
        com: Standard deviation of the centre of mass per axis [m].
        inertia: Standard deviation of the moment of inertia, relative to the guess.
        friction: Standard deviations of translational and turning friction, relative to the guess.
        least: Least mass and moment of inertia, relative to the guess.
        drift: Standard deviation of the change in one second, relative to the first standard deviation.
        slip: Standard deviation of the wheels' sideways velocity [m/s].
        slow: Speed below which parameters are not corrected, because friction is not viscous [m/s].
        turning: Distance after a reversal in which parameters are not corrected, because casters turn around [m].
        drag: Standard deviation of the casters' force [N] and torque [N·m] meanwhile.
        start: Standard deviation of the first velocity about standing still [m/s, rad/s].
        load: Standard deviation of a mass that is suddenly added or removed [kg].
        place: Standard deviation of its position per axis, about the centre of mass [m].
        size: Upper limit of its radius of gyration, roughly [m].
        jolt: Standard deviation of the sudden change of velocity with it [m/s, rad/s].
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
        """Covariance of ``(phi, sigma)`` about a guess, shape (6, 6)."""
        deviations = guess.mass * self.mass, self.com, self.com, guess.inertia * self.inertia
        derivative = guess.phi_derivative()
        result = np.zeros((6, 6))
        result[:4, :4] = derivative @ np.diag(np.square(deviations)) @ derivative.T
        result[4:, 4:] = np.diag(np.square(np.multiply(guess.friction, self.friction)))
        return result


_FARTHEST = 2.0
"""Largest distance of the centre of mass from the axle [m]."""


def nearest_possible(phi: Array, least_mass: float, least_inertia: float) -> Array:
    """Limit ``phi`` (4,) to possible carts: least mass [kg] and central moment of inertia [kg·m²], and centre near."""
    mass = max(float(phi[0]), least_mass)
    _, x, y, turning = phi.tolist()
    far = max(1.0, hypot(x, y) / (mass * _FARTHEST))
    x, y = x / far, y / far
    return np.array([mass, x, y, max(turning, (x * x + y * y) / mass + least_inertia)])

"""Change of a cart's parameters by a load that is added or removed, with four unknowns.

A mass ``dm`` at ``r`` with a moment of inertia ``dm k`` of its own changes ``phi`` by ``dm (1, r_x, r_y, |r|^2 + k)``.
This nonlinear function is replaced by the best linear one for the present belief about the load (posterior
linearisation: García-Fernández, Svensson, Morelande, Särkkä, "Posterior linearization filter: principles and
implementation using sigma points", 2015). Once the position of the load is known, its effect on the moment of inertia
follows before a curve shows it.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.polynomial.hermite_e import hermegauss

from coheft.estimation.cart.prior import CartPrior
from coheft.estimation.geometry.spatial import Array

_SIZE = 4
_NODES, _WEIGHTS = hermegauss(3)
_POINTS: Array = np.array(list(product(_NODES, repeat=_SIZE)))
_SHARES: Array = np.prod(list(product(_WEIGHTS / _WEIGHTS.sum(), repeat=_SIZE)), axis=1)
"""Gauss-Hermite rule for a standard normal variable, exact up to the fifth power of each component."""


@dataclass(frozen=True, eq=False)
class LinearModel:
    """Linear change of ``phi`` by a load: ``change = middle + slope (load - mean) + rest``.

    Attributes:
        middle: Change by the mean load, shape (4,).
        slope: Derivative by ``(dm, r_x, r_y, k)``, shape (4, 4).
        rest: Covariance of the nonlinear rest, shape (4, 4).
    """

    middle: Array
    slope: Array
    rest: Array


def change_of_phi(load: Array) -> Array:
    """Change ``dm (1, r_x, r_y, |r|^2 + k)`` of ``phi`` by loads ``(dm, r_x, r_y, k)``, shapes (..., 4)."""
    mass, x, y, own = np.moveaxis(load, -1, 0)
    return np.stack([mass, mass * x, mass * y, mass * (x * x + y * y + own)], axis=-1)


def linearised(mean: Array, covariance: Array) -> LinearModel:
    """Best linear model for loads with this mean (4,) and positive definite covariance (4, 4)."""
    root = np.linalg.cholesky(covariance)
    changes = change_of_phi(mean + _POINTS @ root.T)
    middle = _SHARES @ changes
    by_point = (changes - middle).T @ (_SHARES[:, None] * _POINTS)
    spread = (changes - middle).T @ (_SHARES[:, None] * (changes - middle))
    return LinearModel(middle, np.linalg.solve(root.T, by_point.T).T, spread - by_point @ by_point.T)


class UnknownLoad:
    """A load that has been added or removed.

    Args:
        phi: Mean of the cart's ``phi`` before, shape (4,), with its covariance (4, 4).
        prior: What is known of loads.
    """

    def __init__(self, phi: Array, covariance: Array, prior: CartPrior) -> None:
        self._phi, self._phi_covariance = phi, covariance
        own = 0.5 * prior.size**2
        self._prior_mean = np.array([0.0, phi[1] / phi[0], phi[2] / phi[0], own])
        variances = prior.load**2, prior.place**2, prior.place**2, own**2
        self._prior_covariance = np.diag(variances)
        self._mean, self._model = self._prior_mean, linearised(self._prior_mean, self._prior_covariance)

    def start(self) -> tuple[Array, Array]:
        """Mean (4,) and covariance (4, 4) of ``phi`` right after the change, by the present linear model."""
        model = self._model
        middle = self._phi + model.middle + model.slope @ (self._prior_mean - self._mean)
        spread = self._phi_covariance + model.slope @ self._prior_covariance @ model.slope.T + model.rest
        return middle, 0.5 * (spread + spread.T)

    def learn(self, phi: Array, covariance: Array) -> None:
        """Linearise again, about the load that follows from the present estimate of the cart.

        That is the mean (4,) and covariance (4, 4) of ``phi``, given the last ``start`` and all measurements since.
        """
        model = self._model
        expected, spread = self.start()
        gain = np.linalg.solve(spread, model.slope @ self._prior_covariance).T
        self._mean = self._prior_mean + gain @ (phi - expected)
        unobservable = np.eye(_SIZE) - gain @ model.slope
        left = unobservable @ self._prior_covariance @ unobservable.T
        left += gain @ (self._phi_covariance + model.rest + covariance) @ gain.T
        self._model = linearised(self._mean, 0.5 * (left + left.T))

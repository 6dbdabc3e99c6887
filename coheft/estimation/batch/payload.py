"""Mass properties with their covariance, physically possible."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.consistency import is_possible, nearest_possible
from coheft.estimation.rigid_body.derivatives import barycentric_derivative
from coheft.estimation.rigid_body.mass_properties import TIMES_IN_MATRIX, Inertia, pack_symmetric, unpack_symmetric
from coheft.estimation.rigid_body.unobservable import Quantity, Unobservable, middle_and_size, unobservable_quantities

_HIDDEN = 100.0
"""Stands for an infinite deviation of what is not observable, times the mass, and metres or their squares."""
_FINEST = 1e-6
"""Least relative deviation of mass, size and inertia: no data are exact."""
_ROUNDING = 1e-13
"""Share of the largest variance that is rounding."""


@dataclass(frozen=True, eq=False)
class Payload:
    """Mass properties in the first robot's grasp frame.

    Attributes:
        inertia: The most likely physically possible estimate.
        measured: The solution of the fit, perhaps impossible.
        covariance: Covariance of ``(m, h, J)``, ``J`` packed, shape (10, 10).
        unobservable: Quantities that are not observable, and what would show them.
    """

    inertia: Inertia
    measured: Inertia
    covariance: Array
    unobservable: tuple[Unobservable, ...]

    @property
    def was_possible(self) -> bool:
        """Whether the solution of the fit is physically possible."""
        return is_possible(self.measured.barycentric())

    @property
    def deviations_off(self) -> float:
        """Distance of the solution from the possible estimate, in its own standard deviations."""
        change = self.measured.barycentric() - self.inertia.barycentric()
        units = np.repeat([self.inertia.mass, 1.0, self.inertia.mass], [1, 3, 6])
        information = _inverse(barycentric_derivative(self.inertia), self.covariance, units)
        return float(np.sqrt(max(float(change @ information @ change), 0.0)))

    def is_seen(self, quantity: Quantity) -> bool:
        """Whether all components of a quantity are observable."""
        return all(part.quantity != quantity for part in self.unobservable)

    @property
    def std(self) -> Array:
        """Standard deviations of ``(m, h, J)``, shape (10,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


def principal_inertia(tensor: Array, covariance: Array) -> tuple[Array, Array, Array]:
    """Moments along principal axes (Zhang et al., eq. 34) of an inertia (3, 3) with this covariance, packed (6, 6).

    Returns:
        Moments, ascending, shape (3,) [kg·m²], right-handed axes as columns, shape (3, 3), and the standard deviations
        of the moments, shape (3,): to first order ``d moment = u^T dJ u``.
    """
    moments, axes = np.linalg.eigh(tensor)
    # Signs are arbitrary: the largest components of the first two axes shall be positive.
    axes *= np.sign(axes[np.argmax(np.abs(axes), axis=0), range(3)])
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    gradients = pack_symmetric(np.einsum("ik,jk->kij", axes, axes)) * TIMES_IN_MATRIX
    variances = np.einsum("ki,ij,kj->k", gradients, covariance, gradients)
    return moments, axes, np.sqrt(np.maximum(variances, 0.0))


def of_central_numbers(numbers: Array) -> Inertia:
    """Inverse of ``Inertia.central``."""
    return Inertia(float(numbers[0]), numbers[1:4], unpack_symmetric(numbers[4:]))


def make_payload(measured: Inertia, covariance: Array, poses: Sequence[Pose]) -> Payload:
    """Find the most likely possible body, and what is not observable.

    ``covariance`` is that of ``(m, h, J)``, shape (10, 10); ``poses`` of the grasps show the size of the load.
    """
    _, length = middle_and_size(poses)
    units = np.repeat([abs(measured.mass), length, abs(measured.mass) * length**2], [1, 3, 6])
    covariance = covariance + np.diag((_FINEST * units) ** 2)
    information = _inverse(barycentric_derivative(measured), covariance, units)
    possible = nearest_possible(measured.barycentric(), information, length)
    unobservable = unobservable_quantities(covariance, abs(measured.mass), length)
    return Payload(Inertia.from_barycentric(possible), measured, covariance, unobservable)


def hidden_covariance(hidden: Array, mass: float) -> Array:
    """Covariance (u, u) of directions that a fit does not show, the columns of ``hidden`` (u, k)."""
    return (_HIDDEN * mass) ** 2 * hidden @ hidden.T


def _inverse(derivative: Array, covariance: Array, units: Array) -> Array:
    """Inverse covariance (10, 10) of numbers with this derivative by unknowns of this covariance and units (10,)."""
    values, vectors = np.linalg.eigh(covariance / np.outer(units, units))
    values = np.maximum(values, max(_ROUNDING * float(values[-1]), _FINEST**2))
    backwards = np.linalg.inv(derivative).T @ (vectors / units[:, None])
    result: Array = (backwards / values) @ backwards.T
    return result

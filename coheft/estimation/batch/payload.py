"""Mass properties as a batch method states them: possible, and with their covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.consistency import is_possible, nearest_possible
from coheft.estimation.rigid_body.derivatives import barycentric_derivative
from coheft.estimation.rigid_body.mass_properties import Inertia, unpack_symmetric
from coheft.estimation.rigid_body.unseen import Quantity, Unseen, middle_and_size, unseen_quantities

_HIDDEN = 100.0
"""Deviation of what the data do not show at all, in units of the mass, times metres or their squares: for infinite."""
_FINEST = 1e-6
"""No load is known better than to this share of its mass, its size, its inertia, whatever exact numbers say."""
_ROUNDING = 1e-13
"""Share of the largest variance below which it is rounding."""


@dataclass(frozen=True, eq=False)
class Payload:
    """Mass properties in the first robot's grasp frame.

    Attributes:
        inertia: Physically possible.
        measured: As it was solved for, perhaps impossible.
        covariance: Of ``(m, h, J)``, ``J`` packed, shape (10, 10).
        unseen: What no number should be claimed for, and what would show it.
    """

    inertia: Inertia
    measured: Inertia
    covariance: Array
    unseen: tuple[Unseen, ...]

    @property
    def was_possible(self) -> bool:
        """Whether it was so without being made so."""
        return is_possible(self.measured.barycentric())

    @property
    def deviations_off(self) -> float:
        """How far what was solved for is from the possible body, in its own standard deviations; 0 if it was one."""
        change = self.measured.barycentric() - self.inertia.barycentric()
        units = np.repeat([self.inertia.mass, 1.0, self.inertia.mass], [1, 3, 6])
        information = _inverse(barycentric_derivative(self.inertia), self.covariance, units)
        return float(np.sqrt(max(float(change @ information @ change), 0.0)))

    def is_seen(self, quantity: Quantity) -> bool:
        """Whether all of it was seen."""
        return all(part.quantity != quantity for part in self.unseen)

    @property
    def std(self) -> Array:
        """Standard deviations of ``(m, h, J)``, shape (10,)."""
        result: Array = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return result


def of_central_numbers(numbers: Array) -> Inertia:
    """Inverse of ``Inertia.central``."""
    return Inertia(float(numbers[0]), numbers[1:4], unpack_symmetric(numbers[4:]))


def make_payload(measured: Inertia, covariance: Array, poses: Sequence[Pose]) -> Payload:
    """State an estimate: the possible body of the highest likelihood, and what is not seen.

    Args:
        measured: As it was solved for.
        covariance: Of ``(m, h, J)``, shape (10, 10).
        poses: Of the grasps, for the size of the load.
    """
    _, length = middle_and_size(poses)
    units = np.repeat([abs(measured.mass), length, abs(measured.mass) * length**2], [1, 3, 6])
    covariance = covariance + np.diag((_FINEST * units) ** 2)
    information = _inverse(barycentric_derivative(measured), covariance, units)
    possible = nearest_possible(measured.barycentric(), information, length)
    unseen = unseen_quantities(covariance, abs(measured.mass), length)
    return Payload(Inertia.from_barycentric(possible), measured, covariance, unseen)


def hidden_covariance(hidden: Array, mass: float) -> Array:
    """What to add to the covariance (u, u) of a fit for directions of which it shows nothing, columns of (u, k)."""
    result: Array = (_HIDDEN * mass) ** 2 * hidden @ hidden.T
    return result


def _inverse(derivative: Array, covariance: Array, units: Array) -> Array:
    """Inverse of the covariance (10, 10) of what has this derivative, (10, 10), by unknowns with these units (10,)."""
    values, vectors = np.linalg.eigh(covariance / np.outer(units, units))
    values = np.maximum(values, max(_ROUNDING * float(values[-1]), _FINEST**2))
    backwards = np.linalg.inv(derivative).T @ (vectors / units[:, None])
    result: Array = (backwards / values) @ backwards.T
    return result

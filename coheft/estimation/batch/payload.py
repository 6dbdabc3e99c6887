"""Mass properties as a batch method states them: possible, with their covariance, and along principal axes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from coheft.estimation.body_motion import perturbed
from coheft.estimation.consistency import is_possible, nearest_possible
from coheft.estimation.inertia_derivatives import barycentric_derivative
from coheft.estimation.inertia_estimate import Quantity, Unseen, middle_and_size, unseen_quantities
from coheft.estimation.rigid_body import Inertia, pack_symmetric, unpack_symmetric
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.team_registration import TeamPoses

_ROTATION_STEP, _TRANSLATION_STEP = 1e-4, 1e-4
_TURNS = (2.0 * np.pi / 3.0, -2.0 * np.pi / 3.0)
"""What a grasp may be turned by about an axis about which it was not seen [rad]: anything, and these show it."""
_TURNING = 0.1
"""Directions with less of a turn in them are translations."""
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


@dataclass(frozen=True, eq=False)
class PrincipalInertia:
    """Moments along principal axes, ascending (Zhang et al., eq. 34).

    Attributes:
        moments: Shape (3,) [kg·m²].
        axes: As columns, right-handed, shape (3, 3).
        std: Of the moments, shape (3,).
    """

    moments: Array
    axes: Array
    std: Array

    @staticmethod
    def of(tensor: Array, covariance: Array | None = None) -> PrincipalInertia:
        """Of an inertia (3, 3), the covariance of which, packed, is (6, 6): ``d moment = u^T dJ u`` to first order."""
        moments, axes = np.linalg.eigh(tensor)
        # Their signs mean nothing: let the largest components of the first two be positive.
        axes *= np.sign(axes[np.argmax(np.abs(axes), axis=0), range(3)])
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        std = np.zeros(3)
        if covariance is not None:
            gradients = pack_symmetric(np.einsum("ik,jk->kij", axes, axes)) * [1, 1, 1, 2, 2, 2]
            std = np.sqrt(np.einsum("ki,ij,kj->k", gradients, covariance, gradients))
        return PrincipalInertia(moments, axes, std)


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


def turned_covariance(solve: Callable[[Sequence[Pose]], Array], team: TeamPoses) -> Array:
    """What a result (u,) gains in covariance (u, u) by turns of grasps that were not seen: they are not small.

    A derivative would not do: at a maximum it is zero, as that of the sum of two forces which were taken for parallel.
    """
    result = solve(team.poses)
    covariance = np.zeros((len(result), len(result)))
    for robot in range(1, len(team.poses)):
        for direction in team.relative(0, robot).unseen:
            size = float(np.linalg.norm(direction.rotation))
            if size < _TURNING:
                continue
            for turn in _TURNS:
                moved = list(team.poses)
                moved[robot] = perturbed(moved[robot], np.concatenate([turn / size * direction.rotation, np.zeros(3)]))
                change = solve(moved) - result
                covariance += np.outer(change, change)
    return covariance


def derivative_by_poses(solve: Callable[[Sequence[Pose]], Array], poses: Sequence[Pose]) -> Array:
    """Derivative (u, 6 N) of a result (u,) by the perturbations of all poses, by central differences.

    Those of the first pose, which defines the frame, are left zero.
    """
    columns = []
    steps = np.repeat([_ROTATION_STEP, _TRANSLATION_STEP], 3)
    for robot in range(1, len(poses)):
        for axis, step in zip(np.eye(6), steps, strict=True):
            moved = [
                solve([perturbed(pose, sign * step * axis) if k == robot else pose for k, pose in enumerate(poses)])
                for sign in (1.0, -1.0)
            ]
            columns.append((moved[0] - moved[1]) / (2.0 * step))
    result: Array = np.stack(columns, axis=1)
    return np.hstack([np.zeros((len(result), 6)), result])

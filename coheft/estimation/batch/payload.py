"""Mass properties as a batch method states them: possible, with their covariance, and along principal axes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from coheft.estimation.body_motion import perturbed
from coheft.estimation.consistency import is_possible, nearest_possible
from coheft.estimation.inertia_derivatives import barycentric_derivative
from coheft.estimation.inertia_estimate import middle_and_size, unseen_quantities
from coheft.estimation.rigid_body import Inertia, pack_symmetric, unpack_symmetric
from coheft.estimation.spatial import Array, Pose

_ROTATION_STEP, _TRANSLATION_STEP = 1e-4, 1e-4


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
    unseen: tuple[str, ...]

    @property
    def was_possible(self) -> bool:
        """Whether it was so without being made so."""
        return is_possible(self.measured.barycentric())

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
    derivative = barycentric_derivative(measured)
    information: Array = np.linalg.inv(derivative @ covariance @ derivative.T).astype(np.float64)
    possible = nearest_possible(measured.barycentric(), information, length)
    unseen = tuple(f"{u.what}: {u.remedy}" for u in unseen_quantities(covariance, abs(measured.mass), length))
    return Payload(Inertia.from_barycentric(possible), measured, covariance, unseen)


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

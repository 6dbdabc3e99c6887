"""Principal moments of inertia with standard deviations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.mass_properties import TIMES_IN_MATRIX, pack_symmetric


@dataclass(frozen=True, eq=False)
class PrincipalInertia:
    """Moments along principal axes, ascending (Zhang et al., eq. 34).

    Attributes:
        moments: Moments, shape (3,) [kg·m²].
        axes: Right-handed axes as columns, shape (3, 3).
        std: Standard deviations of the moments, shape (3,).
    """

    moments: Array
    axes: Array
    std: Array

    @staticmethod
    def of(tensor: Array, covariance: Array) -> PrincipalInertia:
        """Of an inertia (3, 3) with this covariance, packed (6, 6): to first order ``d moment = u^T dJ u``."""
        moments, axes = np.linalg.eigh(tensor)
        # Signs are arbitrary: the largest components of the first two axes shall be positive.
        axes *= np.sign(axes[np.argmax(np.abs(axes), axis=0), range(3)])
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        gradients = pack_symmetric(np.einsum("ik,jk->kij", axes, axes)) * TIMES_IN_MATRIX
        return PrincipalInertia(moments, axes, np.sqrt(np.einsum("ki,ij,kj->k", gradients, covariance, gradients)))

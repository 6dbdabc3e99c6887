"""Moments of inertia along principal axes, and how certain they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.mass_properties import TIMES_IN_MATRIX, pack_symmetric


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
            gradients = pack_symmetric(np.einsum("ik,jk->kij", axes, axes)) * TIMES_IN_MATRIX
            std = np.sqrt(np.einsum("ki,ij,kj->k", gradients, covariance, gradients))
        return PrincipalInertia(moments, axes, std)

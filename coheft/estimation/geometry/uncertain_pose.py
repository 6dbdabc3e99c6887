"""A relative pose with its covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coheft.estimation.geometry.spatial import Array, Pose, skew


@dataclass(frozen=True, eq=False)
class UncertainPose:
    """Estimate of ``pose_j_in_i``.

    Attributes:
        pose: The estimate.
        covariance: Covariance of the error ``(theta, dp)``, shape (6, 6): ``R_true = exp(theta) R`` with theta in the
            axes of ``F_i`` [rad], and ``p_true = p + dp`` [m].
    """

    pose: Pose
    covariance: Array

    def inverse(self) -> UncertainPose:
        """Return the estimate of ``pose_i_in_j`` with its covariance."""
        rotation_transposed = self.pose.rotation.T
        jacobian = np.zeros((6, 6))
        jacobian[:3, :3] = jacobian[3:, 3:] = -rotation_transposed
        jacobian[3:, :3] = -rotation_transposed @ skew(self.pose.translation)
        return UncertainPose(self.pose.inverse(), jacobian @ self.covariance @ jacobian.T)

    @property
    def rotation_std(self) -> float:
        """Root of the largest eigenvalue of theta's covariance [rad]."""
        return float(np.sqrt(max(np.linalg.eigvalsh(self.covariance[:3, :3])[-1], 0.0)))

    @property
    def translation_std(self) -> float:
        """Root of the largest eigenvalue of dp's covariance [m]."""
        return float(np.sqrt(max(np.linalg.eigvalsh(self.covariance[3:, 3:])[-1], 0.0)))

"""Grasp poses of a team with their joint covariance."""

from dataclasses import dataclass

import numpy as np

from coheft.estimation.geometry.body_motion import relative_pose_derivative
from coheft.estimation.geometry.observability import PoseEstimate, SeenInformation
from coheft.estimation.geometry.spatial import Array, Pose


@dataclass(frozen=True, eq=False)
class TeamPoses:
    """Poses of all robots' grasp frames.

    Attributes:
        poses: Poses in the reference robot's grasp frame, the first one.
        covariance: Covariance of all perturbations, shape (6 N, 6 N); zero for the first pose.
        is_settled: Whether the fit has converged.
    """

    poses: tuple[Pose, ...]
    covariance: Array
    is_settled: bool = True

    @property
    def is_observable(self) -> bool:
        """Whether all poses are observable."""
        return not any(self.relative(0, other).unobservable for other in range(1, len(self.poses)))

    def relative(self, i: int, j: int) -> PoseEstimate:
        """``pose_j_in_i`` of two different robots."""
        derivative = relative_pose_derivative(self.poses[i], self.poses[j])
        by_robot = self.covariance.reshape(len(self.poses), 6, len(self.poses), 6)
        covariance = derivative @ by_robot[[i, j]][:, :, [i, j]].reshape(12, 12) @ derivative.T
        seen = SeenInformation.of(np.linalg.inv(covariance).astype(np.float64))
        return PoseEstimate(self.poses[i].inverse() @ self.poses[j], covariance, seen.unobservable())

"""What the sensors of all robots, at given poses, say of the body's motion in a sample.

Gyros and velocities find the twist, accelerometers ``(a, alpha)``: two *channels*. With ``x`` the 28 features of
``registration``, robot i's sensors should read ``P_i x``, of which the columns ``B_i`` belong to the motion that the
channel finds; with its pose perturbed by ``e``, ``e_k D_ik x`` more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from coheft.estimation.measurement import SensorNoise, kinematic_weights
from coheft.estimation.registration import (
    ACCELERATION,
    ACCELERATION_ROWS,
    FEATURES,
    OWN,
    TWIST,
    TWIST_ROWS,
    residual_derivative,
    residual_operator,
)
from coheft.estimation.spatial import Array, Pose

_NO_PRIOR = 1e-6
"""Information on each sample's body motion, in SI units, that keeps matrices regular where two robots do not see all
of alpha."""
_KEPT = 2
"""Of so many sets of poses what follows is kept: those in use, and those that are about to be."""


@dataclass(frozen=True, eq=False)
class Channel:
    """Some of the sensors of all N robots, r per robot, and the part of the body's motion that they find.

    Attributes:
        columns: Of the features, the part of the motion.
        weights: ``W``, inverse variances of the sensors' noise, shape (r,).
        predicted: ``P_i``, shape (N, r, 28).
        by_pose: ``D_i``, shape (N, 6, r, 28), the perturbation second.
        information: ``sum_i B_i^T W B_i``, shape (6, 6).
        coupling: All ``B_i^T W D_i``, shape (6, 6 N, 28), the motion first, then the perturbations of all poses.
    """

    columns: slice
    weights: Array
    predicted: Array
    by_pose: Array
    information: Array
    coupling: Array

    def covariance(self, prior: Array) -> Array:
        """``P``, of the motion (6, 6), with what else says something of it: ``prior`` (6, 6)."""
        return np.linalg.inv(self.information + prior + _NO_PRIOR * np.eye(6)).astype(np.float64)

    def find(self, predictions: Array, prior: Array) -> Array:
        """Weighted least squares of the motion to what robots are predicted to read, and to what it was.

        Args:
            predictions: Linear in the features, shape (N, r, 28).
            prior: How much what it was counts, shape (6, 6).

        Returns:
            The motion, linear in the features as well, shape (6, 28).
        """
        by_motion = (self.weights[:, None] * self.predicted[:, :, self.columns]).reshape(-1, 6)
        prior = prior + _NO_PRIOR * np.eye(6)
        vector = by_motion.T @ predictions.reshape(-1, FEATURES)
        vector[:, self.columns] += prior
        return np.linalg.solve(self.information + prior, vector).astype(np.float64)


def channels(poses: Sequence[Pose], noise: SensorNoise) -> tuple[Channel, Channel]:
    """Twists and accelerations.

    Args:
        poses: Of all robots, in the body frame.
        noise: Of every robot's sensors.
    """
    return _channels(tuple(poses), noise)


@lru_cache(maxsize=_KEPT)
def _channels(poses: tuple[Pose, ...], noise: SensorNoise) -> tuple[Channel, Channel]:
    predicted = -np.array([residual_operator(pose) for pose in poses])
    predicted[:, :, OWN] = 0.0
    by_pose = -np.array([residual_derivative(pose) for pose in poses])

    def channel(rows: slice, columns: slice) -> Channel:
        weights = kinematic_weights(noise)[rows]
        by_motion = predicted[:, rows, columns]
        weighted = weights[:, None] * by_motion
        own = np.ascontiguousarray(by_pose[:, :, rows])
        coupling = weighted.swapaxes(1, 2)[:, None] @ own
        return Channel(
            columns=columns,
            weights=weights,
            predicted=predicted[:, rows],
            by_pose=own,
            information=weighted.reshape(-1, 6).T @ by_motion.reshape(-1, 6),
            coupling=np.ascontiguousarray(coupling.reshape(-1, 6, FEATURES).swapaxes(0, 1)),
        )

    return channel(TWIST_ROWS, TWIST), channel(ACCELERATION_ROWS, ACCELERATION)

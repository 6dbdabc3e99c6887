"""Total wrenches as the newest poses would have carried them.

The total wrench was carried with the poses of its time. Its moments are linear in them,
``sum x (sum_j Ad(g_j) u_j)^T = sum_j C_j Ad(g_j)^T`` with ``C_j = sum x u_j^T``. Every robot keeps its own ``C_j``, and
tells it when new poses come into use; when all have been heard, the moments of the samples before are corrected.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agents.load_moments import CROSS_SHAPE, CROSS_SIZE, cross_moments, number_of_samples
from coheft.estimation.inertia import FEATURES, GRAM_SIZE, repacked_gram, unpacked_gram
from coheft.estimation.pose_sensitivity import MOTION_FEATURES
from coheft.estimation.spatial import Array, Pose

_WRENCH_FEATURES = slice(MOTION_FEATURES.stop, FEATURES)
_SINGULAR = 1e-12
"""Share of the largest singular value of the motions' moments below which a combination of them has not been seen."""
TOLD_SIZE = 3 + CROSS_SIZE
"""Numbers that robots tell each other for it."""


class WrenchCorrection:
    """A correction under way.

    Args:
        total: Sums of all samples so far, with motions as seen with the new poses.
        changed_at: First block with their load.
        last_block: The newest one among them.
        old_poses: That their wrenches were carried with.
        new_poses: That they are to be carried with.

    Attributes:
        last_block: As given.
        count: Number of samples.
    """

    def __init__(
        self, total: Array, changed_at: int, last_block: int, old_poses: Sequence[Pose], new_poses: Sequence[Pose]
    ) -> None:
        self.last_block = last_block
        self._cross = cross_moments(total)
        self._motion_gram = unpacked_gram(total[:GRAM_SIZE])[MOTION_FEATURES, MOTION_FEATURES]
        self.count = number_of_samples(total)
        self._changed_at = changed_at
        self._old_poses, self._new_poses = old_poses, new_poses
        self._left = 1.0
        self._since = np.zeros(GRAM_SIZE)

    def told(self, mean_square_force: float) -> Array:
        """What everybody has to know for it, shape (81,).

        Of which load, how many samples, mean square of the own force [N²], and own ``C_i``.
        """
        return np.concatenate([[self._changed_at, self.count, mean_square_force], self._cross.ravel()])

    def age(self, kept: float, moments: Array) -> None:
        """A block (190 + riders,) has come since; ``kept`` of all before it is left."""
        self._left *= kept
        self._since = kept * self._since + moments[:GRAM_SIZE]

    def is_possible(self, rows: Array, changed_at: int) -> bool:
        """Whether everybody's ``told``, shape (N, 81), is of the load that is remembered now."""
        loads = np.append(rows[:, 0], changed_at)
        return bool(np.all(loads == self._changed_at) and np.all(rows[:, 1] > 0.0))

    def is_exact(self, rows: Array) -> bool:
        """Whether everybody has told of the same samples."""
        return bool(np.all(rows[:, 1] == self.count))

    def apply(self, sums: Array, mean_crosses: Array) -> Array:
        """Correct the sums (k, 190 + riders) of stretches of samples, the longest one first.

        Args:
            sums: All up to now.
            mean_crosses: Everybody's ``C_j`` per sample, shape (N, 13, 6): not everybody need have missed the same.
        """
        correction = np.zeros((FEATURES, FEATURES))
        for cross, old, new in zip(self.count * mean_crosses, self._old_poses, self._new_poses, strict=True):
            correction[MOTION_FEATURES, _WRENCH_FEATURES] += cross @ (new.adjoint() - old.adjoint()).T
        # For stretches that began later, the part of it that follows the motion: what it would do to their mean motion.
        # A share of the whole would move them also in directions that they do not show, where they are compared best.
        by_motion = np.linalg.lstsq(self._motion_gram, correction[MOTION_FEATURES], rcond=_SINGULAR)[0]
        began_before = sums[:, 0] > self._since[0]
        grams = unpacked_gram(began_before[:, None] * (sums[:, :GRAM_SIZE] - self._since))
        corrections = np.zeros_like(grams)
        corrections[:, MOTION_FEATURES] = grams[:, MOTION_FEATURES, MOTION_FEATURES] @ by_motion
        corrections[0] = self._left * correction
        corrected = sums.copy()
        corrected[:, :GRAM_SIZE] += repacked_gram(corrections)
        return corrected


def told_forces(rows: Array) -> Array:
    """Everybody's mean square force [N²] (N,), of everybody's ``told``."""
    return rows[:, 2]


def told_mean_crosses(rows: Array) -> Array:
    """Everybody's ``C_j`` per sample, shape (N, 13, 6), of everybody's ``told``."""
    result: Array = rows[:, 3:].reshape(-1, *CROSS_SHAPE) / rows[:, 1, None, None]
    return result


class MeanSquare:
    """Mean square of the norm of the vectors seen so far."""

    def __init__(self) -> None:
        self._sum = 0.0
        self._count = 0

    def add(self, vectors: Array) -> None:
        """Take in vectors, shape (n, 3)."""
        self._sum += float(np.square(vectors).sum())
        self._count += len(vectors)

    @property
    def mean(self) -> float:
        """The mean, 0 of none."""
        return self._sum / max(self._count, 1)

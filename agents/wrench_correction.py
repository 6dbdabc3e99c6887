"""Total wrenches as the newest poses would have carried them.

The total wrench was carried with the poses of its time. Its moments with the motion are linear in them,
``sum x (sum_j Ad(g_j) u_j)^T = sum_j C_j Ad(g_j)^T`` with ``C_j = sum x u_j^T``. When new poses come into use, every
robot tells how its own wrench follows from the motion, ``B_j = G_j^-1 C_j`` with ``G_j = sum x x^T``; when all have
been heard, the moments of the samples before are corrected. Where all have the same samples, ``G B_j`` is ``C_j``;
where some have missed a few, it still is what their robots' wrenches were in the samples that count here, nearly.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agents.load_moments import CROSS_SHAPE, CROSS_SIZE, cross_moments, number_of_samples, sum_of_squares
from coheft.estimation.inertia import FEATURES, GRAM_SIZE, WRENCH_FEATURES, repacked_gram, unpacked_gram
from coheft.estimation.pose_sensitivity import MOTION_FEATURES
from coheft.estimation.spatial import Array, Pose

_SINGULAR = 1e-12
"""Share of the largest singular value of the motions' moments below which a combination of them has not been seen."""
_LOAD, _FIRST, _COUNT, _FORCE, _UNEXPLAINED, _BY_MOTION = range(6)
TOLD_SIZE = _BY_MOTION + CROSS_SIZE
"""Numbers that robots tell each other for it."""


class WrenchCorrection:
    """A correction under way.

    Args:
        total: Sums (190 + riders,) of all samples so far, with motions as seen with the new poses.
        changed_at: First block with their load.
        first_block: The oldest one among them.
        last_block: The newest one.
        old_poses: That their wrenches were carried with.
        new_poses: That they are to be carried with.

    Attributes:
        last_block: As given.
        count: Number of samples.
    """

    def __init__(
        self,
        total: Array,
        changed_at: int,
        first_block: int,
        last_block: int,
        old_poses: Sequence[Pose],
        new_poses: Sequence[Pose],
    ) -> None:
        self._first_block, self.last_block = first_block, last_block
        gram = motion_grams(total)
        self._by_motion = np.linalg.lstsq(gram, cross_moments(total), rcond=_SINGULAR)[0]
        self.count = number_of_samples(total)
        explained = self._by_motion[:, :3].T @ gram @ self._by_motion[:, :3]
        square = sum_of_squares(total)
        self._unexplained = max(0.0, 1.0 - float(np.trace(explained)) / square) if square > 0.0 else 1.0
        self._changed_at = changed_at
        self._steps = [new.adjoint() - old.adjoint() for old, new in zip(old_poses, new_poses, strict=True)]
        self._since = np.zeros(GRAM_SIZE)

    def told(self, mean_square_force: float) -> Array:
        """What everybody has to know for it, shape (83,).

        Of which load, from which block on, how many samples, mean square of the own force [N²], the share of it that
        does not follow from the motion, and own ``B_i``.
        """
        told = [self._changed_at, self._first_block, self.count, mean_square_force, self._unexplained]
        return np.concatenate([told, self._by_motion.ravel()])

    def age(self, kept: float, moments: Array) -> None:
        """A block (190 + riders,) has come since; ``kept`` of all before it is left."""
        self._since = kept * self._since + moments[:GRAM_SIZE]

    def is_possible(self, rows: Array, changed_at: int) -> bool:
        """Whether everybody's ``told``, shape (N, 83), is of the load that is remembered now."""
        loads = np.append(rows[:, _LOAD], changed_at)
        overlap = np.all(rows[:, _COUNT] > 0.0) and np.all(rows[:, _FIRST] <= self.last_block)
        return bool(np.all(loads == self._changed_at) and overlap)

    def is_exact(self, rows: Array) -> bool:
        """Whether everybody has told of the same samples, as far as their number and first block say."""
        return bool(np.all(rows[:, _COUNT] == self.count) and np.all(rows[:, _FIRST] == self._first_block))

    def mean_lack(self, rows: Array) -> float:
        """How many of these samples a robot lacks: mean over robots, a lower bound, as only counts are compared."""
        return float(np.maximum(0.0, self.count - rows[:, _COUNT]).mean())

    def left(self, rows: Array) -> float:
        """Share of what old poses did to the wrenches of these samples that the correction does not take back.

        That of samples that somebody lacked, and what robots push against each other otherwise than it follows from the
        motion.
        """
        lacked = self.mean_lack(rows) / max(self.count, 1.0)
        return min(1.0, lacked + max(0.0, float(rows[:, _UNEXPLAINED].max())))

    @property
    def count_since(self) -> float:
        """Number of samples that have come since."""
        return number_of_samples(self._since)

    def apply(self, sums: Array, wrenches_by_motion: Array) -> Array:
        """Correct the sums (k, 190 + riders) of stretches of samples that all end now.

        Args:
            sums: All up to now.
            wrenches_by_motion: Everybody's ``B_j``, shape (N, 13, 6).
        """
        by_motion = np.zeros(CROSS_SHAPE)
        for own_by_motion, step in zip(wrenches_by_motion, self._steps, strict=True):
            by_motion += own_by_motion @ step.T
        # Each stretch by its own motion: a share of the whole would move stretches also in directions that they do not
        # show, where they are compared best.
        began_before = sums[:, 0] > self._since[0]
        corrections = np.zeros((len(sums), FEATURES, FEATURES))
        before = began_before[:, None] * (sums[:, :GRAM_SIZE] - self._since)
        corrections[:, MOTION_FEATURES, WRENCH_FEATURES] = motion_grams(before) @ by_motion
        corrected = sums.copy()
        corrected[:, :GRAM_SIZE] += repacked_gram(corrections)
        return corrected


def motion_grams(sums: Array) -> Array:
    """Moments ``G`` of the motion in sums (..., 190 + riders), shape (..., 13, 13)."""
    result: Array = unpacked_gram(sums[..., :GRAM_SIZE])[..., MOTION_FEATURES, MOTION_FEATURES]
    return result


def told_start(rows: Array) -> int:
    """The oldest block that all have, of everybody's ``told``."""
    return int(rows[:, _FIRST].max())


def told_forces(rows: Array) -> Array:
    """Everybody's mean square force [N²] (N,), of everybody's ``told``."""
    return rows[:, _FORCE]


def told_wrenches_by_motion(rows: Array) -> Array:
    """Everybody's ``B_j``, shape (N, 13, 6), of everybody's ``told``."""
    return rows[:, _BY_MOTION:].reshape(-1, *CROSS_SHAPE)

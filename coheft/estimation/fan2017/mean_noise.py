"""What the mean of all robots' estimates leaves of the noise of one (beyond Fan et al.).

Robots share the noise of total wrench and angular acceleration, but it enters each estimate by another lever arm, and
the angular acceleration comes of the same accelerometers that each robot adds its own of. So how much averages out is
no matter of counting robots. It is measured: each block moves each robot's estimate by what noise its residuals hold,
and robots know the mean of these moves. Blocks are independent of each other, so the squares of the moves add up to the
covariance of the mean (a sandwich estimate).
"""

from __future__ import annotations

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.linear_algebra import inverse


class MeanNoise:
    """Covariance of the mean's noise in units of that of the own estimate, in which it does not change with the motion.

    Args:
        memory: Blocks over which the estimates forget. So many have to be seen before the share is measured, and the
            share is taken to be 1, as for one robot, as if that had been measured over half as many: squares of weights
            fade twice as fast.
    """

    def __init__(self, memory: float) -> None:
        self._memory = memory
        self._squares = np.zeros((10, 10))
        self._sum, self._count = 0.5 * memory * np.eye(10), 0.5 * memory
        self._wait = memory

    @property
    def share(self) -> Array:
        """``K``, for ``covariance = root K root^T`` of the mean, with the own ``JointRls.noise_root``: (10, 10)."""
        return self._sum / self._count

    def pause(self, late: int) -> None:
        """Blocks are surprising: neither they nor those of so many blocks before, which come late, are measured."""
        self._squares[:] = 0.0
        self._wait = self._memory + late

    def measure(self, moved: Array, root: Array, decay: float) -> None:
        """Take in a block.

        Args:
            moved: Mean of what it did to all robots' estimates, seen from the own frame, shape (10,).
            root: The own ``JointRls.noise_root``, shape (10, 10).
            decay: What is left of the weight of older samples.
        """
        self._wait -= 1.0
        if self._wait >= self._memory:
            return
        self._squares = decay**2 * self._squares + np.outer(moved, moved)
        if self._wait <= 0.0:
            white = inverse(root)
            self._sum = self._sum + white @ self._squares @ white.T
            self._count += 1.0

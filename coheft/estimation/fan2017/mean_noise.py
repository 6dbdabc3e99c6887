"""How noisy the mean of all robots' estimates is, relative to the estimate of one robot (beyond Fan et al.).

All robots use the same total wrench and angular acceleration, but the noise of these enters each estimate through
another lever arm, and the angular acceleration comes from the accelerometers that each robot also uses by itself. So
the mean of N estimates does not simply have a variance N times smaller; the share is measured. Each block moves each
robot's estimate by the effect of its residuals, and consensus gives the mean of these moves. Blocks are independent, so
their squares add up to its covariance (a sandwich estimator): squares of residuals in the normal equations, because
what these once moved the estimate by changes as information comes and goes.
"""

import numpy as np

from coheft.estimation.fan2017.joint_rls import JointRls
from coheft.estimation.geometry.spatial import Array

_EVERY = 5
"""Squares are compared with the own noise every so many blocks: they change slowly."""


class MeanNoise:
    """Covariance of the mean's noise in units of that of the own estimate, in which it does not change with the motion.

    Args:
        memory: Number of blocks over which estimates forget. Until so many have been seen the share is 1, as for one
            robot. That value then counts like measurements of half as many blocks, because squares of weights fade
            twice as fast.
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
        """Leave out a block that is surprising, and the ``late`` blocks before it, whose means arrive only now."""
        self._squares[:] = 0.0
        self._wait = self._memory + late + 1.0

    def measure(self, pull: Array, own: JointRls) -> None:
        """Process a block.

        Args:
            pull: Residuals in the normal equations that move the own estimate as far as the mean of all robots'
                estimates moved, shape (10,).
            own: The own estimate, as it is now.
        """
        self._wait -= 1.0
        if self._wait >= self._memory:
            return
        self._squares = own.decay**2 * self._squares + np.outer(pull, pull)
        if self._wait <= 0.0 and self._wait % _EVERY == 0.0:
            white = np.linalg.solve(own.noise_root, own.gain)
            self._sum = self._sum + _EVERY * white @ self._squares @ white.T
            self._count += _EVERY

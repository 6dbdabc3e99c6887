"""Covariance of the noise in total wrench and accelerations.

No robot's own data sheet gives the noise of a sum over the team, so it is measured: the load moves smoothly, and
differences of high order contain nothing but noise. One of their seven steps spans two samples, so that the derivative
of a noisy gyro (eq. 16) and white noise of the same variance have differences of the same variance.
"""

from functools import cache, reduce

import numpy as np

from coheft.estimation.geometry.spatial import Array

_GUESSED = 10.0
"""Weight of the guess, as a number of differences."""
_LEARNT = 50.0
"""Once the noise is measured over so many differences, blocks with a much larger variance are not used: the load has
changed in them."""
_JUMP = 25.0
"""Factor by which that variance is larger."""


class InputNoise:
    """Covariance of white noise of ``(F, T, a, alpha)``, with its correlations: ``alpha`` is computed from ``a``.

    Args:
        guess: Covariance before it is measured, shape (12, 12), positive definite.
    """

    def __init__(self, guess: Array) -> None:
        self._sum, self._count = _GUESSED * guess, _GUESSED

    @property
    def covariance(self) -> Array:
        """The covariance as measured so far, shape (12, 12)."""
        return self._sum / self._count

    def measure(self, inputs: Array) -> None:
        """Measure with a block ``(F, T, a, alpha)``, shape (B, 12); fewer than nine samples have no effect."""
        differences = _differences(len(inputs))
        if not len(differences):
            return
        noise = differences @ inputs
        squares = noise.T @ noise
        usual = _JUMP * len(noise) / self._count * self._sum.diagonal()
        if self._count < _LEARNT or np.all(squares.diagonal() < usual):
            self._sum = self._sum + squares
            self._count += len(noise)


@cache
def _differences(samples: int) -> Array:
    """Matrix that takes differences of samples, with the variance of white noise; shape (samples - 8, samples)."""
    steps = [np.array([1.0, -1.0])] * 6 + [np.array([1.0, 0.0, -1.0])]
    kernel = reduce(np.convolve, steps)
    result = np.zeros((max(0, samples - len(kernel) + 1), samples))
    for row, entries in enumerate(result):
        entries[row : row + len(kernel)] = kernel / np.linalg.norm(kernel)
    return result

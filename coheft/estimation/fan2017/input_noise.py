"""How noisy total wrench and accelerations are that joint least squares is fed with.

How large the noise of a sum over the team is follows from no robot's own data sheet. The load moves smoothly, so it is
measured: differences of high order leave nothing but noise. One of their seven steps spans two samples, which makes
them as large for the derivative of a noisy gyro (eq. 16) as for white noise of the same variance.
"""

from functools import cache, reduce

import numpy as np

from coheft.estimation.geometry.spatial import Array

_GUESSED = 10.0
"""So many differences count as having been as large as is guessed, before any is seen."""
_LEARNT = 50.0
"""Of noise that has been measured over so many differences, none is ever again so much larger: the load has changed."""
_JUMP = 25.0
"""So much larger its variance would have to be."""


class InputNoise:
    """Covariance of white noise of ``(F, T, a, alpha)``, with its correlations: ``alpha`` comes of the same ``a``.

    Args:
        guess: Covariance before it is measured, shape (12, 12), positive definite.

    """

    def __init__(self, guess: Array) -> None:
        self._sum, self._count = _GUESSED * guess, _GUESSED

    @property
    def covariance(self) -> Array:
        """What it is by now, shape (12, 12)."""
        return self._sum / self._count

    def measure(self, inputs: Array) -> None:
        """Learn from a block ``(F, T, a, alpha)``, shape (B, 12); nothing from fewer than nine samples."""
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

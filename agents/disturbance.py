"""What errors of the poses add to the total wrenches, beside their noise: it does not average out as noise does."""

from __future__ import annotations

import numpy as np

from coheft.estimation.inertia import InertiaModel
from coheft.estimation.spatial import Array

COHERENCE = 1.0
"""Time for which what the robots push against each other keeps its direction, more or less [s]."""
_SPOILT = 10.0
"""Where poses disturb wrenches more than this, samples are not compared. First fits of few samples disturb less."""
_ROUGH = 2.0
"""Where they disturb wrenches more than this, what they do to the load is not of first order only."""


class Disturbance:
    """How much it is, as far as is known.

    Args:
        rate: Samples per second.

    Attributes:
        size: Its variance in units of that of the noise, infinite as long as nothing is known.
    """

    def __init__(self, rate: float) -> None:
        self._coherence = COHERENCE * rate
        self._shape: Array | None = None
        self.size = np.inf

    def expect(self, covariance: Array, noise: Array) -> None:
        """From now on it has this covariance (6, 6), where the wrench's noise has ``noise`` (6, 6)."""
        self.size = float(np.trace(np.linalg.solve(noise, covariance))) / 6.0
        self._shape = covariance / self.size if self.size > 0.0 else np.zeros((6, 6))

    def tell(self, model: InertiaModel) -> None:
        """Let a model count with its shape."""
        if self._shape is not None:
            model.expect_disturbance(self._shape)

    @property
    def is_spoiling(self) -> bool:
        """Whether a change of the load would not be seen."""
        return self.size > _SPOILT

    @property
    def is_rough(self) -> bool:
        """Whether it does more to the load than is of first order."""
        return self.size > _ROUGH

    @property
    def per_sample(self) -> float:
        """What a sample is told to bear, in units of the noise; of those that it spoils nothing is made anyway."""
        return min(self.size, _SPOILT)

    @property
    def covariance(self) -> Array:
        """Its covariance (6, 6), zero as long as nothing is known."""
        return np.zeros((6, 6)) if self._shape is None else self.size * self._shape

    def of_scores(self, model: InertiaModel, gram: Array) -> Array:
        """Covariance (u, u) of what it adds to the scores of samples with this packed Gram matrix (190,)."""
        if self._shape is None:
            return np.zeros((model.unknowns, model.unknowns))
        coherent = min(float(gram[0]), self._coherence)
        result: Array = coherent * self.size * model.disturbance(gram)
        return result

"""What errors of the poses add to the total wrenches, beside their noise: it does not average out as noise does."""

from __future__ import annotations

import numpy as np

from coheft.estimation.inertia import INERTIA_SIZE, InertiaInformation, InertiaModel
from coheft.estimation.spatial import Array

COHERENCE = 1.0
"""Time for which what the robots push against each other keeps its direction, more or less [s]."""
_SPOILT = 10.0
"""Where poses disturb wrenches more than this, samples are not compared. First fits of few samples disturb less."""
_ROUGH = 1.0
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
        self.forget()

    def forget(self) -> None:
        """Nothing is known."""
        self._shape: Array | None = None
        self.size = np.inf

    def expect(self, covariance: Array, noise: Array) -> None:
        """From now on it has this covariance (6, 6), where the wrench's noise has ``noise`` (6, 6)."""
        self.size = float(np.trace(np.linalg.solve(noise, covariance))) / 6.0
        self._shape = covariance / self.size if self.size > 0.0 else np.zeros((6, 6))

    def tell(self, model: InertiaModel) -> None:
        """Let a model count with it."""
        if self._shape is not None:
            model.expect_disturbance(self._shape, self.per_sample)

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

    def of_scores(self, model: InertiaModel, gram: Array, size: float, samples: float) -> Array:
        """Covariance (u, u) of what it adds to the scores of samples with this packed Gram matrix (190,).

        Args:
            model: The weights.
            gram: Of all samples.
            size: Mean of its sizes over them.
            samples: How many of them it disturbs: no more follow each other.
        """
        if self._shape is None:
            return np.zeros((model.unknowns, model.unknowns))
        result: Array = min(samples, self._coherence) * size * model.disturbance(gram)
        return result


class Uncorrected:
    """Samples that still bear what poses did to them.

    Those since the last correction, which others have not told of yet; and those that somebody lacked who told of his
    share: how his wrench followed from the motion is known only from others.
    """

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Nothing has been corrected of what is remembered now."""
        self._corrected = self._lacked = self._sizes = 0.0

    def age(self, kept: float) -> None:
        """``kept`` of all samples is left."""
        self._corrected, self._lacked, self._sizes = kept * self._corrected, kept * self._lacked, kept * self._sizes

    def correct(self, count: float, lacked: float, size: float) -> None:
        """All samples that are remembered have been corrected but those that were lacked.

        Args:
            count: How many.
            lacked: Of how many of them a share was lacked, and how much of it: one robot's of ``N`` counts ``1 / N``.
                Those of the corrections before are among them: steps of poses add up to what these were off at first.
            size: Of the disturbance so far.
        """
        self._corrected = count
        self._lacked = max(self._lacked, lacked)
        self._sizes = max(self._sizes, lacked * size)

    def of_parameters(
        self, disturbance: Disturbance, model: InertiaModel, information: InertiaInformation, gram: Array
    ) -> Array:
        """Covariance (10, 10) of what the disturbance adds to ``theta`` by all samples, packed Gram matrix (190,)."""
        inverse = np.linalg.inv(information.uncompensated)
        covariance: Array = (inverse @ self.of_scores(disturbance, model, gram) @ inverse)[:INERTIA_SIZE, :INERTIA_SIZE]
        return covariance

    def of_scores(self, disturbance: Disturbance, model: InertiaModel, gram: Array) -> Array:
        """Covariance (u, u) of what it adds to the scores."""
        count = float(gram[0])
        new = max(0.0, count - self._corrected)
        if new + self._lacked < 1.0:
            return np.zeros((model.unknowns, model.unknowns))
        size = (new * disturbance.size + self._sizes) / count
        return disturbance.of_scores(model, gram, size, new + self._lacked)

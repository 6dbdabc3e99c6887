"""Exponential forgetting: a sample that is k samples old counts ``forgetting**k``."""

from functools import cache

import numpy as np

from coheft.estimation.geometry.spatial import Array


@cache
def age_weights(forgetting: float, samples: int) -> Array:
    """Weights of so many samples, the oldest first, shape (samples,); read-only, because others get the same array."""
    weights: Array = forgetting ** np.arange(samples - 1, -1, -1.0)
    weights.flags.writeable = False
    return weights

"""What kernels are compared with: the same in plain numpy, sample by sample."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coheft.estimation.geometry.spatial import Array


def consensus_round(own: Array, others: Sequence[Array], gains: Array) -> Array:
    """One round, sample by sample: shapes (K, B, C) each, gains (K,) of every neighbour."""
    result = np.empty_like(own)
    for stage, gain in enumerate(gains):
        for sample in range(own.shape[1]):
            value = own[stage, sample]
            result[stage, sample] = value + gain * sum(other[stage, sample] - value for other in others)
    return result

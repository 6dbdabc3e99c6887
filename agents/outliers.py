"""Detection of single samples that a smooth signal with noise cannot explain."""

import numpy as np
import numpy.typing as npt

from coheft.estimation.geometry.spatial import Array

_OUTLIER = 12.0
"""A sample is an outlier if it differs from both its neighbours, on the same side, by more standard deviations."""
_UNUSUAL = 3.0
"""The last sample of a block has only one neighbour. It is an outlier if it deviates as much from the extrapolation of
the two samples before it, and this number of times as much as any other sample of the block."""
_REVERSED = 0.3
"""At least this share of the step into an outlier is reversed by the next one: a real sudden change may overshoot, but
it persists."""


def outliers(steps: Array) -> npt.NDArray[np.bool_] | None:
    """Return which signals contain an outlier.

    Args:
        steps: Differences of consecutive samples in units of the noise, shape (n, c): from the one into the first
            sample of the block to the one into its last.

    Returns:
        Shape (c,); None if no signal contains one.
    """
    sizes = np.abs(steps)
    if 2.0 * sizes.max(initial=0.0) <= _OUTLIER:  # nearly always, and fast
        return None
    least, most = np.minimum(sizes[:-1], sizes[1:]), np.maximum(sizes[:-1], sizes[1:])
    are_peaks = (steps[:-1] * steps[1:] < 0.0) & (least > np.maximum(_OUTLIER, _REVERSED * most))
    far: npt.NDArray[np.bool_] = np.any(are_peaks, axis=0)
    bends = np.abs(steps[1:] - steps[:-1])
    if len(bends):
        far |= bends[-1] > np.maximum(_OUTLIER, _UNUSUAL * bends[:-1].max(axis=0, initial=0.0))
    return far if far.any() else None

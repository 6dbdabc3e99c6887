"""Detection of single samples that a smooth signal with noise cannot explain."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from coheft.estimation.geometry.spatial import Array

_OUTLIER = 12.0
"""A sample that differs by more standard deviations from both its neighbours, on the same side, is an outlier."""
_UNUSUAL = 3.0
"""The last sample of a block has one neighbour: it is an outlier if it is as far from where the two before it point,
and so many times as far as any other of the block."""
_BACK = 0.3
"""After an outlier at least so much of the step is taken back: what really changes suddenly may overshoot, but
stays."""
_LARGEST = 1e100
"""Products of larger steps are no numbers."""


def outliers(steps: Array) -> npt.NDArray[np.bool_] | None:
    """Which signals have one.

    Args:
        steps: From each sample to the next, in units of the noise, shape (n, c): into the first sample of a block that
            is looked at, to its last.

    Returns:
        Shape (c,); None if none has.
    """
    sizes = np.abs(steps)
    largest = sizes.max(initial=0.0)
    if 2.0 * largest <= _OUTLIER:
        return None
    if largest > _LARGEST:
        steps = np.clip(steps, -_LARGEST, _LARGEST)
        sizes = np.abs(steps)
    least, most = np.minimum(sizes[:-1], sizes[1:]), np.maximum(sizes[:-1], sizes[1:])
    are_peaks = (steps[:-1] * steps[1:] < 0.0) & (least > np.maximum(_OUTLIER, _BACK * most))
    far: npt.NDArray[np.bool_] = np.any(are_peaks, axis=0)
    bends = np.abs(steps[1:] - steps[:-1])
    if len(bends):
        far |= bends[-1] > np.maximum(_OUTLIER, _UNUSUAL * bends[:-1].max(axis=0, initial=0.0))
    return far if far.any() else None

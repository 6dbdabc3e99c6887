"""Detection of samples that no working sensor would give; the robot does not use them."""

from typing import Any

import numpy as np
import numpy.typing as npt

from coheft.agents.outliers import outliers
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import SensorNoise

_SENSORS = ("gyro", "velocity", "accelerometer", "force", "torque")
_LARGEST = 1e6
"""Larger readings are refused, whatever the unit [rad/s, m/s, m/s², N, N·m]; squares of smaller ones cannot
overflow."""

_ONSET = 2
"""A sensor is about to freeze if so many changes at the end of a block are zero in all three axes."""


class SensorCheck:
    """Checks one robot's samples.

    Attributes:
        fault: The fault found in both of the last two blocks, None if one of them was good.
    """

    def __init__(self, noise: SensorNoise) -> None:
        self._deviations = noise.per_column()
        self._last = np.empty((0, len(self._deviations)))
        self._frozen = np.zeros(len(_SENSORS), dtype=np.bool_)
        self._was_right = True
        self.fault: str | None = None

    def is_usable(self, samples: Array) -> bool:
        """Whether a block of samples (B, 15) can be used; updates ``fault``."""
        found = self._find(np.concatenate([self._last, samples]))
        self.fault = None if self._was_right else found
        self._was_right = found is None
        is_spoiling = found is not None and not np.abs(samples[-1]).max() <= _LARGEST  # affects the next block, too
        self._last = samples[:0] if is_spoiling else samples[-1:]
        return found is None

    def _find(self, samples: Array) -> str | None:
        """Describe the fault in samples (n, 15), of which the first is the last one of the previous block; None if
        there is none.
        """
        frozen, self._frozen = self._frozen, np.zeros_like(self._frozen)
        # Nearly always the sum of squares shows it; it is not below a limit if there is a NaN.
        if not (np.vdot(samples, samples) <= _LARGEST**2 or np.abs(samples).max() <= _LARGEST):
            if not np.isfinite(samples).all():
                return _in_words("is not a finite number", ~np.isfinite(samples).all(axis=0))
            return _in_words("is out of range", np.abs(samples).max(axis=0) > _LARGEST)
        steps = (samples[1:] - samples[:-1]) / self._deviations
        if not steps.all():
            self._frozen = _frozen(samples, steps, frozen)
            if self._frozen.any():
                return _in_words("is frozen", np.repeat(self._frozen, 3))
            limits = np.stack([samples.min(axis=0), samples.max(axis=0)])
            at_limit = (2 * (samples == limits[:, None]).sum(axis=1) > len(samples)) & (limits != 0.0)
            if at_limit.any():
                return _in_words("is saturated", np.any(at_limit, axis=0))
        far = outliers(steps)
        return None if far is None else _in_words("has outliers", far)


def _frozen(samples: Array, steps: Array, before: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Return which sensors are frozen, shape (5,): half of a block or its end has no changes, which noise excludes.

    A sensor that was frozen in the last block (``before``) and starts with the same numbers is still frozen.
    """
    still = (steps.reshape(len(steps), -1, 3) == 0.0).all(axis=2)
    is_frozen: npt.NDArray[np.bool_] = (2 * still.sum(axis=0) >= len(steps)) | (before & still[0])
    if len(still) >= _ONSET:
        is_frozen |= still[-_ONSET:].all(axis=0)
    return is_frozen & samples.reshape(len(samples), -1, 3).any(axis=(0, 2))


def _in_words(what: str, columns: Any) -> str:
    """Describe a fault of the first sensor of which a column (15,) is marked."""
    return f"the {_SENSORS[int(np.argmax(columns)) // 3]} {what}"

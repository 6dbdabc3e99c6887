"""Detection of samples that no working sensor gives, which the robot then does not use."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from coheft.agents.outliers import outliers
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import SensorNoise

_SENSORS = ("gyro", "velocity", "accelerometer", "force", "torque")
_LARGEST = 1e6
"""No sensor of an arm reads more, whatever its unit [rad/s, m/s, m/s², N, N·m]; squares of it are still harmless."""


class SensorCheck:
    """Looks at one robot's samples.

    Args:
        noise: Of its sensors.

    Attributes:
        fault: What has been wrong with the last two blocks, None if one of them was right.
    """

    def __init__(self, noise: SensorNoise) -> None:
        self._deviations = noise.per_column()
        self._last = np.empty((0, len(self._deviations)))
        self._frozen = np.zeros(len(_SENSORS), dtype=np.bool_)
        self._was_right = True
        self.fault: str | None = None

    def is_usable(self, samples: Array) -> bool:
        """Whether a block of samples (B, 15) can be used."""
        found = self._find(np.concatenate([self._last, samples]))
        self.fault = None if self._was_right else found
        self._was_right = found is None
        is_spoiling = found is not None and not np.abs(samples[-1]).max() <= _LARGEST  # the next block, too
        self._last = samples[:0] if is_spoiling else samples[-1:]
        return found is None

    def _find(self, samples: Array) -> str | None:
        """What is wrong with samples (n, 15), the last one of the block before first."""
        frozen, self._frozen = self._frozen, np.zeros_like(self._frozen)
        if not np.abs(samples).max() <= _LARGEST:  # false for what is not a number, too
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
    """Which sensors do not measure, shape (5,): as noise does not repeat, nothing stays as it is for half of a block.

    Nor does a sensor measure yet that was frozen ``before``, in the last block, and begins with the same numbers.
    """
    still = (steps.reshape(len(steps), -1, 3) == 0.0).all(axis=2)
    is_frozen: npt.NDArray[np.bool_] = (2 * still.sum(axis=0) >= len(steps)) | (before & still[0])
    return is_frozen & samples.reshape(len(samples), -1, 3).any(axis=(0, 2))


def _in_words(what: str, columns: Any) -> str:
    """Names the first sensor of which a column (15,) is marked."""
    return f"the {_SENSORS[int(np.argmax(columns)) // 3]} {what}"

"""The sinusoids of one robot's reference motion: drawn when a run is planned, and told to the robot's agent.

A generator of random numbers takes a tenth of the memory of an agent, which needs it for nothing else.
"""

from __future__ import annotations

import msgspec
import numpy as np

_Axes = tuple[float, float, float, float, float, float]


class Waves(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Two sinusoids per axis: rotation about x, y, z, translation along them.

    Attributes:
        frequencies: Of both [Hz].
        phases: Of both [rad].
    """

    frequencies: tuple[_Axes, _Axes]
    phases: tuple[_Axes, _Axes]


def draw_waves(frequency: tuple[float, float], seed: int) -> Waves:
    """Frequencies from a range [Hz], and any phases; equal seeds draw alike."""
    rng = np.random.default_rng(seed)
    frequencies = rng.uniform(*frequency, size=(2, 6))
    phases = rng.uniform(0.0, 2.0 * np.pi, size=(2, 6))
    return msgspec.convert({"frequencies": frequencies.tolist(), "phases": phases.tolist()}, Waves)

"""The sinusoids of one robot's reference motion: drawn when a run is planned, and part of the agent's configuration.

A random number generator would take a tenth of an agent's memory, and is not needed for anything else.
"""

from __future__ import annotations

import msgspec
import numpy as np

_Axes = tuple[float, float, float, float, float, float]


class Waves(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Two sinusoids per axis: rotation about x, y, z, translation along them.

    Attributes:
        frequencies: Frequencies of both [Hz].
        phases: Phases of both [rad].
    """

    frequencies: tuple[_Axes, _Axes]
    phases: tuple[_Axes, _Axes]


def draw_waves(frequency: tuple[float, float], seed: int) -> Waves:
    """Draw frequencies from a range [Hz], and phases; equal seeds give equal results."""
    rng = np.random.default_rng(seed)
    frequencies = rng.uniform(*frequency, size=(2, 6))
    phases = rng.uniform(0.0, 2.0 * np.pi, size=(2, 6))
    return msgspec.convert({"frequencies": frequencies.tolist(), "phases": phases.tolist()}, Waves)

"""A slow motion to and fro along one direction, during which the payload can be weighed."""

from __future__ import annotations

import msgspec
import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.wire.config import AgentConfig


class SwaySettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The settings in ``[settings.sway]`` of a scenario.

    Attributes:
        amplitude: Greatest distance from home [m].
        period: Time to and fro [s].
    """

    amplitude: float = 0.02
    period: float = 4.0


class Sway:
    """Sways along a direction drawn for each robot. See ``coheft.agents.motion.reference.ReferenceMotion``."""

    def __init__(self, config: AgentConfig) -> None:
        settings = msgspec.convert(config.motion_settings, SwaySettings)
        direction = np.random.default_rng(config.seed).normal(size=3)
        self._way = settings.amplitude * direction / np.linalg.norm(direction)
        self._omega = 2.0 * np.pi / settings.period
        self._rate, self._block = config.rate, config.block

    def reference(self, block: int) -> Array:
        """Displacement ``(rotation, position)`` and its rate at each sample of a block, shape (B, 12)."""
        phase = self._omega * (block * self._block + np.arange(self._block)) / self._rate
        motion = np.zeros((self._block, 12))
        motion[:, 3:6] = np.outer((1.0 - np.cos(phase)) / 2.0, self._way)
        motion[:, 9:12] = np.outer(self._omega * np.sin(phase) / 2.0, self._way)
        return motion

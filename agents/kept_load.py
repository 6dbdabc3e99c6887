"""What a team knew of the load when it was dissolved: the next one holds its own samples against it.

Who starts again with an empty memory is told it by its neighbours, as it is told its pose: a sensor that has gone off
meanwhile looks like another load, and only who knows the former one can doubt that.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping

import numpy as np

from agents.estimator import Channels
from coheft.estimation.inertia import INERTIA_SIZE
from coheft.estimation.load_comparison import KnownLoad
from coheft.estimation.spatial import Array

_CHANNEL = "kept_load"
_ROWS, _COLUMNS = np.triu_indices(INERTIA_SIZE)
_COVARIANCE = 2 + INERTIA_SIZE
"""Where the covariance begins in what is told: after two numbers for the frame, and ``theta``."""
_SIZE = _COVARIANCE + len(_ROWS)
_MOST = 1e9
"""What is more uncertain is not told: it is of no use, and messages with numbers that are very large are refused."""
_ROUNDING = 1e-9

Where = tuple[int, str]
"""A body frame: its number, and the robot that defines it. When that one leaves, the frame moves a little."""


class KeptLoad:
    """What one robot knows of it, in the body frame of that team."""

    def __init__(self) -> None:
        self._where: Where = 0, ""
        self._load: KnownLoad | None = None

    def keep(self, where: Where, load: KnownLoad | None) -> None:
        """A team with this body frame is dissolved; if it knew nothing, what was known before stays."""
        if load is not None:
            self._where, self._load = where, load

    def forget(self) -> None:
        """The body frame will not be quite where it was."""
        self._load = None

    def seen_in(self, where: Where) -> KnownLoad | None:
        """In this body frame; None if nothing is known in that one."""
        return self._load if where == self._where else None

    def hear(self, inbox: Mapping[str, Channels], where: Where) -> None:
        """Neighbours may know it in the frame of the next team; what this robot knows itself it does not ask for."""
        for channels in inbox.values():
            told = channels.get(_CHANNEL)
            is_asked = self.seen_in(where) is None and where[0] > 0
            if is_asked and told is not None and told.shape == (_SIZE,) and tuple(told[:2]) == _numbers(where):
                self.keep(where, _decoded(told))

    def channels(self, where: Where) -> dict[str, Array]:
        """What to tell the neighbours, with whom the next team will have this body frame."""
        load = self.seen_in(where)
        if load is None or np.abs(load.covariance).max() > _MOST:
            return {}
        return {_CHANNEL: np.concatenate([_numbers(where), load.parameters, load.covariance[_ROWS, _COLUMNS]])}


def _numbers(where: Where) -> tuple[int, int]:
    number, robot = where
    return number, zlib.crc32(robot.encode())


def _decoded(told: Array) -> KnownLoad | None:
    """From what a neighbour tells; None if that is no covariance."""
    covariance = np.zeros((INERTIA_SIZE, INERTIA_SIZE))
    covariance[_ROWS, _COLUMNS] = covariance[_COLUMNS, _ROWS] = told[_COVARIANCE:]
    deviations = np.sqrt(np.maximum(covariance.diagonal(), 0.0))
    if not deviations.all():
        return None
    correlation = covariance / np.outer(deviations, deviations)
    if np.linalg.eigvalsh(correlation)[0] < -_ROUNDING:
        return None
    return KnownLoad(told[2:_COVARIANCE], covariance)

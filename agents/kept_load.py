"""What a team knew of the load when it was dissolved: the next one holds its own samples against it.

Who starts again with an empty memory is told it by its neighbours, as it is told its pose: a sensor that has gone off
meanwhile looks like another load, and only who knows the former one can doubt that.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from agents.estimator import Channels
from coheft.estimation.inertia import INERTIA_SIZE
from coheft.estimation.load_comparison import KnownLoad
from coheft.estimation.spatial import Array

_CHANNEL = "kept_load"
_ROWS, _COLUMNS = np.triu_indices(INERTIA_SIZE)
_COVARIANCE = 2 + INERTIA_SIZE
"""Where the covariance begins in what is told: after the frame's number, the number of samples, and ``theta``."""
_SIZE = _COVARIANCE + len(_ROWS)


class KeptLoad:
    """What one robot knows of it, in the body frame of that team."""

    def __init__(self) -> None:
        self._frame = 0
        self._load: KnownLoad | None = None

    def keep(self, frame: int, load: KnownLoad | None) -> None:
        """A team with the body frame of this number is dissolved; if it knew nothing, what was known before stays."""
        if load is not None:
            self._frame, self._load = frame, load

    def forget(self) -> None:
        """The body frame will not be quite where it was."""
        self._load = None

    def seen_in(self, frame: int) -> KnownLoad | None:
        """In the body frame with this number; None if nothing is known in that one."""
        return self._load if frame == self._frame else None

    def hear(self, inbox: Mapping[str, Channels], frame: int) -> None:
        """Neighbours may know it in the frame of the next team; what this robot knows itself it does not ask for."""
        for channels in inbox.values():
            told = channels.get(_CHANNEL)
            if self.seen_in(frame) is None and told is not None and told.shape == (_SIZE,) and told[0] == frame:
                self.keep(frame, _decoded(told))

    def channels(self) -> dict[str, Array]:
        """What to tell the neighbours."""
        if self._load is None:
            return {}
        head = np.concatenate([[self._frame, self._load.samples], self._load.parameters])
        return {_CHANNEL: np.concatenate([head, self._load.covariance[_ROWS, _COLUMNS]])}


def _decoded(told: Array) -> KnownLoad | None:
    """From what a neighbour tells; None if that is no covariance."""
    covariance = np.zeros((INERTIA_SIZE, INERTIA_SIZE))
    covariance[_ROWS, _COLUMNS] = covariance[_COLUMNS, _ROWS] = told[_COVARIANCE:]
    deviations = np.sqrt(np.maximum(covariance.diagonal(), 0.0))
    if not deviations.all() or np.linalg.eigvalsh(covariance / np.outer(deviations, deviations))[0] < 0.0:
        return None
    return KnownLoad(told[2:_COVARIANCE], covariance, float(told[1]))

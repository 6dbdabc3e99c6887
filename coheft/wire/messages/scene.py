"""Where robots hold the payload, what it looks like, and what else does not change during a run."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np


class BoxShape(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a part of the payload looks like.

    Attributes:
        size: Its edge lengths [m].
        position: Of its centre in the payload's frame [m].
        rotation_deg: Of its edges against the payload's axes, rotation vector [degrees].
    """

    size: tuple[float, float, float]
    position: tuple[float, float, float]
    rotation_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)


def _no_triangles() -> np.ndarray[Any, Any]:
    return np.empty((0, 3, 3), dtype=np.float32)


class Scene(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What does not change during a run: what is held, and by whom.

    Attributes:
        robots: Who holds the payload.
        rotations: Of the true pose of each robot's ``F_i`` in the payload's frame, (N, 3, 3).
        translations: Of the same, (N, 3) [m].
        neighbours: Who talks with whom.
        boxes: What the payload is made of; empty if no more is known of it than its mass properties.
        triangles: What a payload from a file looks like, in its frame, (k, 3, 3) in single precision [m]; often none.
        home: Where the payload's frame was in the world when the robots took hold, its axes along the world's [m].
    """

    robots: list[str]
    rotations: np.ndarray[Any, Any]
    translations: np.ndarray[Any, Any]
    neighbours: dict[str, list[str]]
    boxes: list[BoxShape] = []
    triangles: np.ndarray[Any, Any] = msgspec.field(default_factory=_no_triangles)
    home: tuple[float, float, float] = (0.0, 0.0, 0.0)


class SlippedGrasp(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where a robot holds the payload since its grasp has slipped.

    Attributes:
        rotation: Of its ``F_i`` in the payload's frame, (3, 3).
        translation: Of the same, (3,) [m].
    """

    rotation: np.ndarray[Any, Any]
    translation: np.ndarray[Any, Any]

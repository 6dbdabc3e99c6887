"""What does not change during a run: the robots, their grasps, and the shape of the payload."""

from typing import Any

import msgspec
import numpy as np


class BoxShape(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A box that is part of the payload's shape.

    Attributes:
        size: Edge lengths [m].
        position: Position of its centre in the payload's frame [m].
        rotation_deg: Orientation of its edges in the payload's frame, rotation vector [degrees].
    """

    size: tuple[float, float, float]
    position: tuple[float, float, float]
    rotation_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Scene(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The constant part of the scene.

    Attributes:
        robots: Names of the robots that hold the payload.
        rotations: Rotations of the true poses of the robots' ``F_i`` in the payload's frame, (N, 3, 3).
        translations: Translations of the same poses, (N, 3) [m].
        boxes: Boxes that make up the payload; empty if only its mass properties are given.
        triangles: Surface of a payload from a file, in its frame, (k, 3, 3) in single precision [m]; often empty.
        home: Initial position of the payload's frame in the world, with axes parallel to the world's [m].
    """

    robots: list[str]
    rotations: np.ndarray[Any, Any]
    translations: np.ndarray[Any, Any]
    neighbours: dict[str, list[str]]
    boxes: list[BoxShape] = []
    triangles: np.ndarray[Any, Any] = msgspec.field(default_factory=lambda: np.empty((0, 3, 3), dtype=np.float32))
    home: tuple[float, float, float] = (0.0, 0.0, 0.0)


class SlippedGrasp(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Pose of a robot's ``F_i`` in the payload's frame after it has slipped: (3, 3), and (3,) [m]."""

    rotation: np.ndarray[Any, Any]
    translation: np.ndarray[Any, Any]

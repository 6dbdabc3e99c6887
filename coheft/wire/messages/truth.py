"""The scene, which does not change during a run, and what is true, as the server tells observers."""

from typing import Any

import msgspec
import numpy as np

from coheft.wire.messages.structs import Message, sent_as


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


class PayloadTruth(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """True mass properties in the payload's frame."""

    mass: float
    com: np.ndarray[Any, Any]
    tensor: np.ndarray[Any, Any]


class LoadState(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A load on the payload.

    Attributes:
        mass: Its present mass [kg]; 0 when all has leaked out.
        position: Position of its centre in the payload's frame [m].
        size: Its edge lengths [m].
        leak: Rate at which it loses mass [kg/s].
    """

    id: int
    mass: float
    position: tuple[float, float, float]
    size: tuple[float, float, float]
    leak: float = 0.0


@sent_as(22, block="block")
class Truth(Message, frozen=True):
    """Server to observers, once per block; agents cannot receive it.

    Attributes:
        block: The block; the payload was constant during it.
        time: End of the block [s].
        position: Position of the payload's frame in the world at the block's last sample, (3,) [m].
        quaternion: Its orientation, scalar first, (4,).
        total_wrench: Sum of the **measured** wrenches of the last sample, of all robots that hold the payload,
            transformed with the true poses to the payload's frame, (6,).
        samples: Every robot's last sample of the block, in the order of the scene, (N, 15), each in its own frame,
            columns as in ``MeasurementBlock``.
        loads_since: Time of the last change of the loads [s], because an observer may have missed blocks. None in
            recordings of protocol version 5, which do not contain it.
        slipped: Grasps that have slipped so far, by robot; all others are as in the scene.
        clocks: How far the clocks that the operator has set are ahead, by robot [s].
    """

    block: int
    time: float
    payload: PayloadTruth
    loads: list[LoadState]
    position: np.ndarray[Any, Any]
    quaternion: np.ndarray[Any, Any]
    total_wrench: np.ndarray[Any, Any]
    samples: np.ndarray[Any, Any]
    loads_since: float | None = None
    slipped: dict[str, SlippedGrasp] = msgspec.field(default_factory=dict)
    clocks: dict[str, float] = msgspec.field(default_factory=dict)

"""Shapes that stand for what is known: boxes for inertia, ellipsoids for doubt, arms for robots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.wire.messages.structs import BoxShape, Scene
from coheft.wire.scenario.section import pose_of

SIGMAS = 3.0
"""Half lengths of an ellipsoid of doubt, in standard deviations."""
_THINNEST = 1e-3
"""Least edge of a box that stands for an inertia [m]: estimates need not belong to a body."""
_MARGIN = 0.3
"""Least half extent of what the robots hold [m], by which stands are placed."""
_LINK_SHARE = 0.62
"""Length of one of an arm's two links, relative to the way from its shoulder to its home: the elbow stays bent."""


def equivalent_box(inertia: Inertia) -> tuple[Pose, Array]:
    """The homogeneous box with the same mass, centre of mass and inertia.

    Principal moments ``I_k`` make edges ``a_k^2 = 6 (I_i + I_j - I_k) / m``.

    Returns:
        Its pose in the frame of the inertia, and its edge lengths (3,) [m].
    """
    moments, axes = np.linalg.eigh(inertia.tensor)
    squares = 6.0 * (moments.sum() - 2.0 * moments) / inertia.mass
    return Pose(_right_handed(axes), inertia.com), np.sqrt(np.maximum(squares, _THINNEST**2))


def ellipsoid(centre: Array, covariance: Array) -> tuple[Pose, Array]:
    """Where something lies, as far as its covariance (3, 3) tells: pose and half lengths (3,) at three sigma."""
    variances, axes = np.linalg.eigh(covariance)
    return Pose(_right_handed(axes), centre), SIGMAS * np.sqrt(np.maximum(variances, 0.0))


def _right_handed(axes: Array) -> Array:
    result: Array = axes * np.array([1.0, 1.0, np.sign(np.linalg.det(axes))])
    return result


def box_edges(pose: Pose, size: Array) -> Array:
    """The twelve edges of a box, shape (12, 2, 3)."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    pairs = [(i, i | bit) for i in range(8) for bit in (1, 2, 4) if not i & bit]
    return pose.apply(corners[np.array(pairs)] * size)


def rotation_to(direction: Array) -> Array:
    """A rotation (3, 3) that turns the z axis into a direction, shape (3,)."""
    length = np.linalg.norm(direction)
    if length == 0.0:
        return np.eye(3)
    z = np.array([0.0, 0.0, 1.0])
    unit = direction / length
    axis = np.cross(z, unit)
    sine = np.linalg.norm(axis)
    if sine < 1e-9:
        return np.eye(3) if unit[2] > 0.0 else np.diag([1.0, -1.0, -1.0])
    return rotation_exp(axis / sine * np.arctan2(sine, unit[2]))


@dataclass(frozen=True, eq=False)
class Stand:
    """Where a robot stands and how long its arm is: made up, for the physics knows nothing but its hand.

    Attributes:
        shoulder: In the world, (3,) [m]; its foot is on the ground below.
        link: Length of each of the arm's two links [m].
    """

    shoulder: Array
    link: float

    def elbow(self, hand: Array) -> Array:
        """Where the elbow is, above the line from shoulder to hand, all (3,) in the world [m]."""
        reach = hand - self.shoulder
        length = float(np.linalg.norm(reach))
        height = np.sqrt(max(self.link**2 - (0.5 * length) ** 2, 0.0))
        up = np.array([0.0, 0.0, 1.0])
        up -= reach * (reach @ up) / max(length**2, 1e-12)
        result: Array = self.shoulder + 0.5 * reach + height * up / max(float(np.linalg.norm(up)), 1e-9)
        return result


def extent(scene: Scene) -> float:
    """Half the width of what the robots hold, from its middle to the farthest hand [m]."""
    centre = scene.translations.mean(axis=0)
    return max(_MARGIN, float(np.linalg.norm((scene.translations - centre)[:, :2], axis=1).max()))


def stands(scene: Scene) -> tuple[Stand, ...]:
    """A stand for each robot, around the payload, so that arms reach inwards."""
    hands = scene.translations + np.array(scene.home)
    outwards = (scene.translations - scene.translations.mean(axis=0))[:, :2]
    size = extent(scene)
    result = []
    for index, (hand, out) in enumerate(zip(hands, outwards, strict=True)):
        if np.linalg.norm(out) < 1e-3 * size:  # in the middle: each goes its own way
            angle = 2.0 * np.pi * index / len(hands)
            out = np.array([np.cos(angle), np.sin(angle)])
        direction = np.append(out / np.linalg.norm(out), 0.0)
        shoulder = hand + 0.75 * size * direction - np.array([0.0, 0.0, 0.22 * size])
        result.append(Stand(shoulder, _LINK_SHARE * float(np.linalg.norm(shoulder - hand))))
    return tuple(result)


def payload_boxes(scene: Scene) -> list[BoxShape]:
    """What the payload looks like; a plate between the hands where no one knows."""
    if scene.boxes:
        return scene.boxes
    low, high = scene.translations.min(axis=0), scene.translations.max(axis=0)
    x, y, z = (low + high) / 2.0
    width, depth, height = np.maximum(high - low, 0.1 * extent(scene)).tolist()
    return [BoxShape(size=(width, depth, height), position=(float(x), float(y), float(z)))]


def place_under_ray(boxes: Sequence[BoxShape], origin: Array, direction: Array) -> Array | None:
    """Where a ray first hits one of the boxes, all in the payload's frame; None if it misses.

    Args:
        boxes: The boxes.
        origin: Where the ray begins, (3,) [m].
        direction: Where it goes, (3,).
    """
    hits = []
    for box in boxes:
        pose = pose_of(box.position, box.rotation_deg).inverse()
        start, way = pose.apply(origin), pose.rotation @ direction
        half = np.array(box.size) / 2.0
        with np.errstate(divide="ignore", invalid="ignore"):
            first, second = (-half - start) / way, (half - start) / way
        enter = np.nanmax(np.minimum(first, second))
        leave = np.nanmin(np.maximum(first, second))
        if enter <= leave and leave >= 0.0:
            hits.append(max(enter, 0.0))
    if not hits:
        return None
    result: Array = origin + min(hits) * direction
    return result


def resting_place(boxes: Sequence[BoxShape], hit: Array, height: float) -> tuple[float, float, float]:
    """Centre of a load of that height [m] that lies on top of what is straight above a place that was hit.

    Args:
        boxes: The boxes.
        hit: A place on one of them, (3,) in the payload's frame [m].
        height: Of the load [m].
    """
    above = np.array([hit[0], hit[1], 1e3])
    top = place_under_ray(boxes, above, np.array([0.0, 0.0, -1.0]))
    surface = float(top[2]) if top is not None else float(hit[2])
    return float(hit[0]), float(hit[1]), surface + 0.5 * height

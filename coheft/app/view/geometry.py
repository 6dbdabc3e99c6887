"""Shapes of the scene: boxes for inertias, ellipsoids for covariances, arms for robots."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh

from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.linear_algebra import principal_axes
from coheft.estimation.rigid_body.mass_properties import Inertia, edges_of_box
from coheft.wire.messages.truth import BoxShape, Scene
from coheft.wire.scenario.payload_extent import corners
from coheft.wire.scenario.section import pose_of

SIGMAS = 3.0
"""Half lengths of ellipsoids and half widths of bands, in standard deviations."""
_THINNEST = 1e-3
"""Shortest edge of a box for an inertia [m], because no body may have the estimated one."""
_MARGIN = 0.3
"""Smallest half extent of the grasps [m], by which stands are placed."""
FOV = float(np.radians(42.0))
"""Vertical field of view of cameras [rad]."""
_VIEW_FROM = np.array([0.52, -0.70, 0.49]) / np.linalg.norm([0.52, -0.70, 0.49])
"""Direction from the team to the camera."""
_TEAM = 1.9
"""Half the width of a team with its stands, relative to its extent."""
_NARROW, _ABOVE_PANEL = 0.62, 0.4
"""Aspect ratio below which the panel is at the bottom, and the share of the height above it."""
_ROUNDING = 1e-9
_LINK_SHARE = 0.62
"""Length of a link of an arm, relative to the distance from its shoulder to its home, so that the elbow is bent."""


def equivalent_box(inertia: Inertia) -> tuple[Pose, Array]:
    """Return pose and edges (3,) [m] of the homogeneous box with the same mass, centre of mass and inertia."""
    moments, axes = principal_axes(inertia.tensor)
    return Pose(axes, inertia.com), np.maximum(edges_of_box(inertia.mass, moments), _THINNEST)


def ellipsoid(centre: Array, covariance: Array) -> tuple[Pose, Array]:
    """Return the ellipsoid of a covariance (3, 3): pose, and half lengths (3,) at three standard deviations."""
    variances, axes = principal_axes(covariance)
    return Pose(axes, centre), SIGMAS * np.sqrt(np.maximum(variances, 0.0))


def box_edges(pose: Pose, size: Array) -> Array:
    """Return the twelve edges of a box, shape (12, 2, 3)."""
    pairs = [(i, i | bit) for i in range(8) for bit in (1, 2, 4) if not i & bit]
    edges: Array = corners(pose, size)[np.array(pairs)]
    return edges


def rotation_to(direction: Array) -> Array:
    """Return a rotation (3, 3) of the z axis into a direction, shape (3,)."""
    if not direction.any():
        return np.eye(3)
    turn: Array = trimesh.geometry.align_vectors([0.0, 0.0, 1.0], direction)[:3, :3]  # type: ignore[no-untyped-call]
    return turn


@dataclass(frozen=True, eq=False)
class Stand:
    """A drawn stand and arm of a robot; the physics has only its hand.

    Attributes:
        shoulder: Position in the world, (3,) [m], above the foot.
        link: Length of each of the arm's two links [m].
    """

    shoulder: Array
    link: float

    def elbow(self, hand: Array) -> Array:
        """Return the elbow's position above the line from shoulder to hand, all (3,) in the world [m]."""
        reach = hand - self.shoulder
        length = float(np.linalg.norm(reach))
        height = np.sqrt(max(self.link**2 - (0.5 * length) ** 2, 0.0))
        up = np.array([0.0, 0.0, 1.0])
        up -= reach * (reach @ up) / max(length**2, 1e-12)
        result: Array = self.shoulder + 0.5 * reach + height * up / max(float(np.linalg.norm(up)), 1e-9)
        return result


def extent(scene: Scene) -> float:
    """Return the horizontal distance from the middle of the grasps to the farthest one [m]."""
    centre = scene.translations.mean(axis=0)
    return max(_MARGIN, float(np.linalg.norm((scene.translations - centre)[:, :2], axis=1).max()))


def whole_team(middle: Array, size: float, aspect: float) -> tuple[Array, Array]:
    """Return the camera's target and position, both (3,) [m], from which all robots with their stands are visible.

    ``middle`` is the centre of the team, (3,) [m], ``size`` its ``extent`` [m], and ``aspect`` the width of the window
    over its height. In a narrow window the panel covers the lower part, so the team is in the upper one.
    """
    half = np.tan(0.5 * FOV)
    free = 1.0 if aspect > _NARROW else _ABOVE_PANEL
    distance = _TEAM * size * (1.0 + 1.0 / (half * min(aspect, free)))
    right = np.cross(_VIEW_FROM, [0.0, 0.0, -1.0])
    up = np.cross(_VIEW_FROM, right / np.linalg.norm(right))
    look_at: Array = middle - (1.0 - free) * half * distance * up
    return look_at, look_at + distance * _VIEW_FROM


def stands(scene: Scene) -> tuple[Stand, ...]:
    """Return a stand for each robot around the payload, so that arms point inwards."""
    hands = scene.translations + np.array(scene.home)
    outwards = (scene.translations - scene.translations.mean(axis=0))[:, :2]
    size = extent(scene)
    result = []
    for index, (hand, out) in enumerate(zip(hands, outwards, strict=True)):
        if np.linalg.norm(out) < 1e-3 * size:  # in the middle: directions are spread evenly
            angle = 2.0 * np.pi * index / len(hands)
            out = np.array([np.cos(angle), np.sin(angle)])
        direction = np.append(out / np.linalg.norm(out), 0.0)
        shoulder = hand + 0.75 * size * direction - np.array([0.0, 0.0, 0.22 * size])
        result.append(Stand(shoulder, _LINK_SHARE * float(np.linalg.norm(shoulder - hand))))
    return tuple(result)


def payload_boxes(scene: Scene) -> list[BoxShape]:
    """Return the payload's boxes; a plate between the hands if there are none."""
    if scene.boxes:
        return scene.boxes
    low, high = scene.translations.min(axis=0), scene.translations.max(axis=0)
    x, y, z = (low + high) / 2.0
    width, depth, height = np.maximum(high - low, 0.1 * extent(scene)).tolist()
    return [BoxShape(size=(width, depth, height), position=(float(x), float(y), float(z)))]


def surface_of(scene: Scene) -> Array:
    """Return the payload's surface as triangles in its frame, shape (n, 3, 3) [m]."""
    if len(scene.triangles):
        return scene.triangles.astype(np.float64)
    return triangles_of(payload_boxes(scene))


def triangles_of(boxes: Sequence[BoxShape]) -> Array:
    """Return the surfaces of boxes, shape (n, 3, 3) [m]."""
    poses = [pose_of(each.position, each.rotation_deg) for each in boxes]
    shapes = [trimesh.creation.box(each.size).triangles for each in boxes]
    return np.concatenate([pose.apply(shape) for pose, shape in zip(poses, shapes, strict=True)])


def place_under_ray(triangles: Array, origin: Array, direction: Array) -> Array | None:
    """Return the first point of a surface (n, 3, 3) on a ray, all in the payload's frame [m]; None if there is none.

    Source: Möller and Trumbore, "Fast, minimum storage ray/triangle intersection", J. Graphics Tools 2 (1997).
    """
    corner, first, second = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    across, start = np.cross(direction, second), origin - corner
    turned = np.cross(start, first)
    volume = np.einsum("nk,nk->n", first, across)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(np.abs(volume) > _ROUNDING**2, 1.0 / volume, np.nan)
        u, v = scale * np.einsum("nk,nk->n", start, across), scale * (turned @ direction)
        distance = scale * np.einsum("nk,nk->n", second, turned)
    is_hit = (u >= -_ROUNDING) & (v >= -_ROUNDING) & (u + v <= 1.0 + _ROUNDING) & (distance >= 0.0)
    if not is_hit.any():
        return None
    result: Array = origin + distance[is_hit].min() * direction
    return result


def resting_place(triangles: Array, hit: Array, height: float) -> tuple[float, float, float]:
    """Return the centre of a load of some height that lies on the payload's surface (n, 3, 3), at the highest place
    above or below a point on it (3,), all in the payload's frame [m].
    """
    above = np.array([hit[0], hit[1], 1e3])
    top = place_under_ray(triangles, above, np.array([0.0, 0.0, -1.0]))
    surface = float(top[2]) if top is not None else float(hit[2])
    return float(hit[0]), float(hit[1]), surface + 0.5 * height

"""What a payload from a file looks like: some hundred triangles, for views. Nothing is computed from them."""

from __future__ import annotations

import base64
import math
from itertools import pairwise

import numpy as np

from coheft.estimation.geometry.spatial import Array

MOST = 1500
"""Triangles that are kept: they travel with every answer of the server."""
_CELLS = (128, 96, 64, 48, 32, 24, 16, 12, 8, 6, 4, 2)
"""Along the longest edge; vertices in one cell become one."""
_SIDES = 16
"""Of a round shape."""


def coarse(triangles: Array) -> Array:
    """A surface of at most ``MOST`` triangles that looks like this one, shape (n, 3, 3) to (k, 3, 3) [m]."""
    for cells in _CELLS:
        if len(triangles) <= MOST:
            break
        triangles = _clustered(triangles, cells)
    return triangles[:MOST]


def _clustered(triangles: Array, cells: int) -> Array:
    points = triangles.reshape(-1, 3)
    low, size = points.min(axis=0), float(np.ptp(points, axis=0).max())
    _, cell = np.unique(np.floor((points - low) * (cells / size)), axis=0, return_inverse=True)
    cell = cell.reshape(-1)
    sums = np.stack([np.bincount(cell, weights=points[:, axis]) for axis in range(3)], axis=1)
    middles = sums / np.bincount(cell)[:, None]
    corners = cell.reshape(-1, 3)
    is_flat = (corners == np.roll(corners, 1, axis=1)).any(axis=1)
    _, first = np.unique(np.sort(corners[~is_flat], axis=1), axis=0, return_index=True)
    result: Array = middles[corners[~is_flat][first]]
    return result


def box(halves: Array) -> Array:
    """The surface of a box around the origin, half its edge lengths given, shape (12, 3, 3)."""
    square = np.array([[1.0, -1.0, -1.0], [1.0, 1.0, -1.0], [1.0, 1.0, 1.0], [1.0, -1.0, 1.0]])
    sides = [np.roll(square, axis, axis=1) for axis in range(3)]
    faces = [*sides, *(-side[::-1] for side in sides)]
    result: Array = np.concatenate([[face[[0, 1, 2]], face[[0, 2, 3]]] for face in faces]) * halves
    return result


def turned(profile: list[tuple[float, float]]) -> Array:
    """A surface that a line of points (radius, height) leaves when it turns about the z axis, shape (k, 3, 3)."""
    angles = np.linspace(0.0, 2.0 * math.pi, _SIDES + 1)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    rings = [np.column_stack([radius * ring, np.full(_SIDES + 1, height)]) for radius, height in profile]
    parts = []
    for lower, upper in pairwise(rings):
        parts.append(np.stack([lower[:-1], lower[1:], upper[1:]], axis=1))
        parts.append(np.stack([lower[:-1], upper[1:], upper[:-1]], axis=1))
    return np.concatenate(parts)


def capsule(radius: float, half: float) -> Array:
    """Of a cylinder of that half length along z, with half a ball at each end; a ball if it has none."""
    steps = np.linspace(0.0, 0.5 * math.pi, 5)
    bottom = [(radius * math.sin(step), -half - radius * math.cos(step)) for step in steps]
    return turned([*bottom, *((away, -height) for away, height in reversed(bottom))])


def cylinder(radius: float, half: float) -> Array:
    """Of a cylinder of that half length along z."""
    return turned([(0.0, -half), (radius, -half), (radius, half), (0.0, half)])


def to_text(triangles: Array) -> str:
    """As a scenario holds it: base 64 of little-endian numbers in single precision."""
    return base64.b64encode(coarse(triangles).astype("<f4").tobytes()).decode()


def from_text(text: str) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    """What ``to_text`` made, shape (k, 3, 3) [m].

    Raises:
        ValueError: It is something else.
    """
    triangles = np.frombuffer(base64.b64decode(text, validate=True), dtype="<f4").reshape(-1, 3, 3)
    if not np.isfinite(triangles).all():
        raise ValueError("it holds numbers that are not finite")
    return triangles

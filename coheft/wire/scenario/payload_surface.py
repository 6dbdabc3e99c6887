"""The surface of a payload from a file: some hundred triangles, for views only."""

import base64

import numpy as np

from coheft.estimation.geometry.spatial import Array

MOST = 1500
"""Largest number of triangles: they are part of every answer of the server."""
_CELLS = (128, 96, 64, 48, 32, 24, 16, 12, 8, 6, 4, 2)
"""Numbers of cells along the longest edge; vertices in one cell become one."""


def coarse(triangles: Array) -> Array:
    """Return a similar surface of at most ``MOST`` triangles, shape (n, 3, 3) to (k, 3, 3) [m]."""
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


def to_text(triangles: Array) -> str:
    """Return a surface as a scenario holds it: base 64 of little-endian numbers in single precision."""
    return base64.b64encode(coarse(triangles).astype("<f4").tobytes()).decode()


def from_text(text: str) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    """Return the triangles of ``to_text``, shape (k, 3, 3) [m]; raise ``ValueError`` if it is something else."""
    triangles = np.frombuffer(base64.b64decode(text, validate=True), dtype="<f4").reshape(-1, 3, 3)
    if not np.isfinite(triangles).all():
        raise ValueError("it holds numbers that are not finite")
    if len(triangles) > MOST:
        raise ValueError(f"it holds {len(triangles)} triangles, more than the {MOST} for which messages have room")
    return triangles

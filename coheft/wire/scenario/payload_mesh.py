"""The closed surface of a payload from a file, and the mass properties of its inside.

A surface is a soup of triangles: files repeat a vertex for every triangle, with rounding. It may have several shells,
which may touch. A point belongs to the payload if the surface winds around it once. Where it winds around it twice,
shells overlap; where it winds backwards, a shell is turned inside out.
"""

from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from coheft.errors import refuse_scenario
from coheft.estimation.geometry.spatial import Array, rotation_from_quaternion
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.wire.process.log import LOG

IntArray = npt.NDArray[np.integer]

_LIGHTEST, _LEAST_DENSITY, _DENSEST = 0.5, 10.0, 23_000.0
"""Densities of closed boxes, of materials, and of the densest one [kg/m³]."""
_SAME_VERTEX = 1e-6
"""Vertices are the same if they are closer than this share of the largest coordinate; files hold seven digits."""
_BESIDE = 1e-4
"""Depth of test points behind a triangle, as a share of the shell's size."""
_LOOKED_AT = 16
"""Number of the largest triangles of a shell that get test points."""
_LITTLE = 1e-3
"""Share of the volume up to which overlaps do not matter."""
_DARTS = 128
"""Number of random points where two shells may overlap."""
_MOST_PAIRS = 2000
_MOST_ANGLES = 1_000_000
"""Number of solid angles that are computed at a time."""


def read_triangles(path: Path) -> Array:
    """Return the corners of a file's triangles, shape (n, 3, 3), in its own unit: STL, OBJ, PLY, or MuJoCo's MSH.

    What is not in the format that the suffix names is a ``ValueError``.
    """
    import trimesh

    try:
        if path.suffix.lower() == ".msh":
            return _read_msh(path)
        surface = trimesh.load_mesh(path, process=False, skip_materials=True)
    except Exception as error:  # the readers may raise anything
        reason = str(error) or type(error).__name__
        raise ValueError(
            f"it cannot be read as {path.suffix or 'a mesh'} ({reason}): is it whole? Expected triangles in .stl, "
            f".obj or .ply: convert other formats"
        ) from error
    triangles = np.array(getattr(surface, "triangles", ()), dtype=np.float64)
    if triangles.size == 0:
        raise ValueError("it has no triangles: is it whole?")
    if not np.all(np.isfinite(triangles)):
        raise ValueError("it has coordinates that are no numbers")
    return triangles


def _read_msh(path: Path) -> Array:
    import mujoco

    spec = mujoco.MjSpec()
    mesh = spec.add_mesh(name="payload", file=str(path.absolute()))
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # does not mind what the surface is like
    spec.worldbody.add_body().add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="payload")
    model = spec.compile()
    vertices = model.mesh_vert @ rotation_from_quaternion(model.mesh_quat[0]).T + model.mesh_pos[0]
    return cast("Array", vertices[model.mesh_face].astype(np.float64))


def filled(triangles: Array, mass: float | None, density: float | None, place: str) -> Inertia:
    """Return the mass properties of the homogeneous inside of a surface, in its own frame.

    Its triangles have corners (n, 3, 3) [m], counterclockwise as seen from outside. Either its mass [kg] or its density
    [kg/m³] is given. A surface that encloses nothing, or is ambiguous, is a ``ScenarioError``; ``place`` names its key.
    """
    import trimesh

    points = check_surface(triangles, place)
    with np.errstate(all="ignore"):
        middle = points.mean(axis=0)  # avoids a loss of digits far from the frame's origin
        solid = trimesh.triangles.mass_properties(triangles - middle)
        volume = np.float64(solid["volume"])
        amount = mass if mass is not None else float(cast("float", density) * volume)
        whole = Inertia(amount, solid["center_mass"] + middle, np.array(solid["inertia"]) * (amount / volume))
        is_solid = np.all(np.isfinite(whole.tensor)) and np.all(np.linalg.eigvalsh(whole.pseudo_inertia()) > 0.0)
    if not is_solid:
        refuse_scenario(place, f"it encloses {volume:g} m³, which has no extent in some direction")
    lightest, filling = _LIGHTEST if density is None else _LEAST_DENSITY, amount / volume
    if not lightest < filling < _DENSEST:
        refuse_scenario(
            place,
            f"it encloses {volume:.3g} m³ of {filling:.3g} kg/m³, expected {lightest:g} to {_DENSEST:g}: "
            f"'payload.scale' is the length of its unit in metres, 0.0254 for inches; masses are in kg, densities in "
            f"kg/m³",
        )
    return whole


def check_surface(triangles: Array, place: str) -> Array:
    """Return the vertices of a surface, shape (m, 3), if it encloses something once; ``ScenarioError`` if not.

    Arguments are as of ``filled``.
    """
    import trimesh

    faces, points = _faces(triangles)
    has_area = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    faces, triangles = faces[has_area], triangles[has_area]
    _check_closed(faces, place)
    _check_copies(faces, place)
    graph: Any = trimesh.graph  # triangles belong to one shell if an edge is only theirs
    _check_shells(triangles, graph.connected_component_labels(graph.face_adjacency(faces), len(faces)), place)
    return points


def _faces(triangles: Array) -> tuple[IntArray, Array]:
    """Return the indices of the vertices of all triangles (n, 3), and the positions of vertices (m, 3)."""
    points, same = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    pairs = cKDTree(points).query_pairs(_SAME_VERTEX * float(np.abs(points).max()), output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points),) * 2)
    _, merged = connected_components(links, directed=False)
    return merged[same.reshape(-1, 3)], points


def _check_closed(faces: IntArray, place: str) -> None:
    """Check that as many triangles are on one side of every edge as on the other."""
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    _, number = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True)
    touched = np.bincount(number)
    balance = np.bincount(number, weights=np.sign(ends[:, 1] - ends[:, 0]))
    open_edges = np.count_nonzero(touched % 2)
    if open_edges:
        refuse_scenario(
            place,
            f"its surface is not closed: {open_edges} edges have a triangle on one side only; expected a surface "
            f"without holes, or else its mass properties ('payload.properties')",
        )
    turned = np.count_nonzero(balance)
    if turned:
        refuse_scenario(
            place,
            f"its triangles do not agree where outside is, at {turned} edges; expected corners that go "
            f"counterclockwise as seen from outside ('recalculate normals' in modelling programs)",
        )


def _check_copies(faces: IntArray, place: str) -> None:
    """Check that no triangle is there twice, on the same side; shells that touch have one on either side."""
    first = np.argmin(faces, axis=1)[:, None]
    turned = np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1)
    copies = len(faces) - len(np.unique(turned, axis=0))
    if copies:
        refuse_scenario(
            place,
            f"{copies} of its {len(faces)} triangles are copies of others, so that what they enclose would "
            f"count twice: remove the copies",
        )


def _check_shells(triangles: Array, shell_of: IntArray, place: str) -> None:
    """Check that no shell is inside out, and remark where shells overlap."""
    shells = [triangles[shell_of == shell] for shell in range(int(shell_of.max(initial=-1)) + 1)]
    volumes = np.array([np.linalg.det(shell - shell.mean(axis=(0, 1))).sum() / 6.0 for shell in shells])
    for shell in (shells[number] for number in np.flatnonzero(volumes < 0.0)):
        if np.median(_winding(_points_inside(shell), triangles)) < -0.5:
            turned = "its surface" if len(shells) == 1 else f"a shell of it, {_where(shell)},"
            refuse_scenario(
                place,
                f"{turned} is inside out; expected corners of triangles that go counterclockwise as seen from "
                f"outside, and the other way round only around a cavity",
            )
    solid = [shells[number] for number in np.flatnonzero(volumes > 0.0)]
    twice, where = overlap_of(solid, triangles)
    if where is not None and twice > _LITTLE * volumes.sum():
        LOG.warning(
            f"coheft: {place}: shells of its surface overlap, {where}: about {twice / volumes.sum():.1%} of its volume "
            f"is counted twice, as MuJoCo does; join them into one shell if they are one body, and turn the inner one "
            f"inside out if it is a cavity"
        )


def _points_inside(shell: Array) -> Array:
    """Return points just behind the largest triangles of a shell that winds backwards, shape (k, 3)."""
    normals = np.cross(shell[:, 1] - shell[:, 0], shell[:, 2] - shell[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    largest = np.argsort(lengths)[-_LOOKED_AT:]
    largest = largest[lengths[largest] > 0.0]
    step = _BESIDE * float(np.ptp(shell.reshape(-1, 3), axis=0).max())
    inside: Array = shell[largest].mean(axis=1) + step * normals[largest] / lengths[largest, None]
    return inside


def overlap_of(solid: list[Array], triangles: Array) -> tuple[float, str | None]:
    """Return the volume that is in at least two shells, and a description of its place; None if there is none."""
    if len(solid) < 2:
        return 0.0, None
    lower = np.array([shell.min(axis=(0, 1)) for shell in solid])
    upper = np.array([shell.max(axis=(0, 1)) for shell in solid])
    random = np.random.default_rng(0)
    twice, where = 0.0, None
    near = cKDTree((lower + upper) / 2.0).query_pairs(float(np.linalg.norm(upper - lower, axis=1).max()))
    for one, other in sorted(near)[:_MOST_PAIRS]:
        begin, end = np.maximum(lower[one], lower[other]), np.minimum(upper[one], upper[other])
        if np.any(end - begin <= _BESIDE * (upper[one] - lower[one])):
            continue
        darts = random.uniform(begin, end, (_DARTS, 3))
        for shell in (solid[one], solid[other]):
            if len(darts):
                darts = darts[_winding(darts, shell) > 0.5]
        around = np.round(_winding(darts, triangles)) if len(darts) else np.zeros(0)
        is_twice = around > 1.5
        if is_twice.any():
            # Of w shells at a place, w - 1 count too often, which its w (w - 1) / 2 pairs share.
            twice += float(np.prod(end - begin)) * float(np.sum(2.0 / around[is_twice])) / _DARTS
            where = where or _where(darts[is_twice])
    return twice, where


def _where(points: Array) -> str:
    x, y, z = np.round(points.reshape(-1, 3).mean(axis=0), 4) + 0.0  # no -0
    return f"around ({x:.3g}, {y:.3g}, {z:.3g}) m"


def _winding(points: Array, triangles: Array) -> Array:
    """Return how often a surface (n, 3, 3) winds around points (p, 3), shape (p,): its solid angles divided by 4 π.

    Source: Van Oosterom and Strackee, "The solid angle of a plane triangle", IEEE Trans. Biomed. Eng. 30 (1983), (8).
    """
    total = np.zeros(len(points))
    part = max(1, _MOST_ANGLES // len(points))
    for start in range(0, len(triangles), part):
        corner = triangles[None, start : start + part] - points[:, None, None]
        a, b, c = corner[:, :, 0], corner[:, :, 1], corner[:, :, 2]
        length_a, length_b, length_c = (np.linalg.norm(side, axis=-1) for side in (a, b, c))
        ab, bc, ca = (np.einsum("...k,...k", u, v) for u, v in ((a, b), (b, c), (c, a)))
        triple = np.einsum("...k,...k", a, np.cross(b, c))
        total += np.arctan2(triple, length_a * length_b * length_c + ab * length_c + bc * length_a + ca * length_b).sum(
            axis=1
        )
    return total / (2.0 * np.pi)

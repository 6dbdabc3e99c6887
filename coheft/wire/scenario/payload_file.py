"""Payloads from files of the user's own: a body of an MJCF model, or a mesh, becomes numbers when a scenario is read.

What comes after, on whatever host, knows mass properties and grasps only, and opens no file. The mass properties are
those that MuJoCo computes; it is imported only if a scenario names a file, and never by an agent.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import msgspec
import numpy as np

from coheft.errors import ScenarioError, one_line
from coheft.estimation.geometry.spatial import Array, Pose, rotation_from_quaternion, rotation_log
from coheft.estimation.rigid_body.mass_properties import Inertia, combined
from coheft.wire.scenario.payload import MassProperties, Payload, vector_of
from coheft.wire.scenario.payload_extent import Extent, check_holds, corners
from coheft.wire.scenario.schema import Grasp, Scenario

if TYPE_CHECKING:
    import mujoco

_NAMES_SHOWN = 12


def read_files(scenario: Scenario, origin: str, folder: Path) -> Scenario:
    """The scenario with mass properties and grasps in place of the files and sites that it names.

    Args:
        scenario: As written, see ``scenario_checks.check_choices``.
        origin: Names the scenario's source in errors.
        folder: What paths are relative to.

    Raises:
        ScenarioError: A file cannot be read, or what it holds cannot be carried.
    """
    payload = scenario.payload
    if payload.mjcf is not None:
        place = f"{origin}: key 'payload.mjcf'"
        model = _read(folder, payload.mjcf, _compile_mjcf, place)
        root = _find_body(model, payload.body, f"{origin}: key 'payload.body'")
        what, advice = "the body", "lengths in models are in metres"
    elif payload.mesh is not None:
        place = f"{origin}: key 'payload.mesh'"
        model = _read(folder, payload.mesh, lambda path: _compile_mesh(path, payload), place)
        _check_closed(model, place)
        root = 1
        what, advice = "the mesh", f"if it is drawn in millimetres, set 'payload.scale' = {1e-3 * payload.scale:g}"
    else:
        return scenario
    properties = _mass_properties(model, root, place)
    extent = _extent(model, root, properties)
    extent.check_size(place, what, advice)
    check_holds(scenario, extent, origin)
    robots = scenario.robots
    if robots.sites:
        place = f"{origin}: key 'robots.sites'"
        grasps = _grasps(model, root, robots.sites, place)
        for name, grasp in zip(robots.sites, grasps, strict=True):
            extent.check_position(place, f"site {name!r}", grasp.position)
        robots = msgspec.structs.replace(robots, sites=(), grasps=grasps)
    held = Payload(properties=properties, load_slots=payload.load_slots)
    return msgspec.structs.replace(scenario, payload=held, robots=robots)


def _read(folder: Path, name: str, compiled: Callable[[Path], mujoco.MjModel], place: str) -> mujoco.MjModel:
    """Have MuJoCo compile a file."""
    path = folder / name
    try:
        path.open("rb").close()
    except OSError as error:
        _refuse(place, f"{path} cannot be read: {error.strerror}; paths are relative to the scenario's file")
    except ValueError as error:
        _refuse(place, f"{name!r}: no file can have this name: {error}")
    try:
        return compiled(path)
    except ValueError as error:
        _refuse(place, f"{path}: MuJoCo cannot use it: {' '.join(str(error).split())}")


def _compile_mjcf(path: Path) -> mujoco.MjModel:
    import mujoco

    spec = mujoco.MjSpec.from_file(str(path))
    spec.compiler.fusestatic = False  # bodies keep their names
    return spec.compile()


def _compile_mesh(path: Path, payload: Payload) -> mujoco.MjModel:
    import mujoco

    spec = mujoco.MjSpec()
    mesh = spec.add_mesh(name="payload", file=str(path.absolute()), scale=[payload.scale] * 3)
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_EXACT
    amount = {"mass": payload.mass} if payload.mass is not None else {"density": payload.density}
    body = spec.worldbody.add_body(name="payload")
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="payload", **amount)
    return spec.compile()


def _check_closed(model: mujoco.MjModel, place: str) -> None:
    """Check that every edge of the mesh has a triangle on either side: MuJoCo does not, and an open one has no inside.

    Vertices at the same place are the same: STL files repeat them for every triangle.
    """
    _, same = np.unique(model.mesh_vert, axis=0, return_inverse=True)
    faces = same.reshape(-1)[model.mesh_face]
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    forth, back = edges @ [len(model.mesh_vert), 1], edges @ [1, len(model.mesh_vert)]
    open_edges = np.count_nonzero(~np.isin(forth, back))
    if open_edges:
        _refuse(
            place,
            f"its surface is not closed: {open_edges} edges have a triangle on one side only; expected a surface "
            f"without holes, or else its mass properties ('payload.properties')",
        )


def _find_body(model: mujoco.MjModel, name: str | None, place: str) -> int:
    """Index of the body that is held."""
    names = [model.body(body).name for body in range(1, model.nbody)]
    if name is not None:
        if name not in names:
            _refuse(place, f"found {name!r}, but there is no such body; there are: {_listed(names)}")
        return 1 + names.index(name)
    top = [body for body in range(1, model.nbody) if model.body_parentid[body] == 0]
    if not top:
        _refuse(place, "the model has no body: expected what is held inside of a <body>, not of <worldbody> alone")
    if len(top) > 1:
        _refuse(place, f"it is missing, but the model has several: {_listed(model.body(body).name for body in top)}")
    return top[0]


def _mass_properties(model: mujoco.MjModel, root: int, place: str) -> MassProperties:
    """Of a body and all that is fixed to it, in its own frame."""
    import mujoco

    inside = _fixed_to(model, root)
    for joint in range(model.njnt):
        kind = mujoco.mjtJoint(model.jnt_type[joint])
        body = model.jnt_bodyid[joint]
        if body in inside and not (body == root and kind == mujoco.mjtJoint.mjJNT_FREE):
            name, what = model.joint(joint).name or "without a name", kind.name.removeprefix("mjJNT_").lower()
            _refuse(
                place,
                f"body {model.body(root).name!r} has a joint ({name}, {what}): expected one rigid body, which may "
                f"have a free joint, but none of another kind and none inside",
            )
    frames = _frames(model)
    with np.errstate(all="ignore"):
        parts = [
            Inertia(float(model.body_mass[body]), np.zeros(3), np.diag(model.body_inertia[body])).carried(
                frames[root].inverse() @ frames[body] @ _pose(model.body_ipos[body], model.body_iquat[body])
            )
            for body in inside
            if model.body_mass[body] > 0.0
        ]
        if not parts:
            _refuse(place, f"body {model.body(root).name!r} has no mass: give its geoms a density or a mass")
        whole = combined(parts)
        is_solid = np.all(np.isfinite(whole.tensor)) and np.all(np.linalg.eigvalsh(whole.pseudo_inertia()) > 0.0)
    if not is_solid:
        _refuse(place, f"a body of {whole.mass:g} kg with such moments of inertia has no extent in some direction")
    return MassProperties.of(whole)


def _extent(model: mujoco.MjModel, root: int, properties: MassProperties) -> Extent:
    """Of the shapes that are fixed to a body, or, if there are none, of a box with its mass properties."""
    import mujoco

    frames = _frames(model)
    inside = _fixed_to(model, root)
    unbounded = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)
    points = []
    for geom in range(model.ngeom):
        body, kind = model.geom_bodyid[geom], model.geom_type[geom]
        if body not in inside or kind in unbounded:
            continue
        on_root = frames[root].inverse() @ frames[body] @ _pose(model.geom_pos[geom], model.geom_quat[geom])
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            mesh = model.geom_dataid[geom]
            vertices = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
            points.append(vertices @ on_root.rotation.T + on_root.translation)
        else:
            middle, halves = model.geom_aabb[geom].reshape(2, 3)
            points.append(corners(on_root @ Pose(np.eye(3), middle), 2.0 * halves))
    return Extent.around(np.concatenate(points)) if points else Extent.like(properties)


def _grasps(model: mujoco.MjModel, root: int, names: Sequence[str], place: str) -> tuple[Grasp, ...]:
    """Sites that are fixed to the body, as grasps in its frame."""
    inside = _fixed_to(model, root)
    frames = _frames(model)
    sites = {model.site(site).name: site for site in range(model.nsite) if model.site_bodyid[site] in inside}
    grasps = []
    for count, name in enumerate(names):
        if name in names[:count]:
            _refuse(place, f"found {name!r} twice, but expected a site of its own for each robot")
        if name not in sites:
            _refuse(
                place,
                f"found {name!r}, but body {model.body(root).name!r} has no such site; it has: {_listed(sites)}",
            )
        site = sites[name]
        on_body = _pose(model.site_pos[site], model.site_quat[site])
        pose = frames[root].inverse() @ frames[model.site_bodyid[site]] @ on_body
        grasps.append(Grasp(vector_of(pose.translation), vector_of(np.degrees(rotation_log(pose.rotation)))))
    return tuple(grasps)


def _fixed_to(model: mujoco.MjModel, root: int) -> list[int]:
    """A body and all bodies below it; parents come before their children."""
    inside = [root]
    for body in range(root + 1, model.nbody):
        if model.body_parentid[body] in inside:
            inside.append(body)
    return inside


def _frames(model: mujoco.MjModel) -> list[Pose]:
    """Pose of every body's frame in the world, with all joints at zero."""
    frames = [Pose.identity()]
    for body in range(1, model.nbody):
        on_parent = _pose(model.body_pos[body], model.body_quat[body])
        frames.append(frames[model.body_parentid[body]] @ on_parent)
    return frames


def _pose(position: Array, quaternion: Array) -> Pose:
    return Pose(rotation_from_quaternion(quaternion), np.array(position))


def _listed(names: Iterable[str]) -> str:
    """Names for an error."""
    known = [name or "(without a name)" for name in names]
    return ", ".join(known[:_NAMES_SHOWN] + ["..."] * (len(known) > _NAMES_SHOWN)) or "none"


def _refuse(place: str, what: str) -> NoReturn:
    raise ScenarioError(f"{place}: {one_line(what)}")

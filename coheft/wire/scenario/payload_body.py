"""The body of a model that is held: its mass properties, its extent, and its sites.

The mass properties are those that MuJoCo computes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from coheft.errors import ScenarioError, refuse_scenario
from coheft.estimation.geometry.spatial import Array, Pose, rotation_log
from coheft.estimation.rigid_body.mass_properties import Inertia, combined
from coheft.wire.process.log import LOG
from coheft.wire.scenario.payload import MassProperties, vector_of
from coheft.wire.scenario.payload_extent import Extent
from coheft.wire.scenario.payload_mesh import check_surface, overlap_of
from coheft.wire.scenario.payload_model import (
    DEFAULT_DENSITY,
    PayloadModel,
    keep_what_is_written,
    leave_out_defaults,
    leave_out_looks,
)
from coheft.wire.scenario.schema import Grasp

if TYPE_CHECKING:
    import mujoco

_NAMES_SHOWN = 12
_SMALL_SHARE = 1e-3
"""Share of the mass from which shapes that collide with nothing are remarked."""
_SMALL_DIFFERENCE = 0.01
"""Difference of a mass or a moment of inertia, as a share of it, from which fillings of meshes are remarked."""


@dataclass(frozen=True)
class HeldBody:
    """A body of a model, and all bodies that are fixed to it.

    Attributes:
        root: Number of the body, whose frame is the payload's frame.
        inside: Numbers of the body and of all below it; parents come before their children.
    """

    model: PayloadModel
    root: int
    inside: tuple[int, ...]

    @classmethod
    def find(cls, model: PayloadModel, name: str | None, place: str) -> Self:
        """Return the body that is named, or else the one that floats, or else the only one.

        A ``ScenarioError`` says that there is none, that there are several, or that it is not one rigid body.
        """
        compiled = model.compiled
        names = [compiled.body(body).name for body in range(1, compiled.nbody)]
        if name is None:
            tops = model.floating or [body for body in range(1, compiled.nbody) if compiled.body_parentid[body] == 0]
            if not tops:
                refuse_scenario(
                    place, "the model has no body: expected what is held inside of a <body>, not of <worldbody> alone"
                )
            if len(tops) > 1:
                found = _listed(compiled.body(body).name for body in tops)
                refuse_scenario(place, f"it is missing, but the model has several: {found}")
            root = tops[0]
        elif name in names:
            root = 1 + names.index(name)
        else:
            refuse_scenario(place, f"found {name!r}, but there is no such body; there are: {_listed(names)}")
        inside = [root]
        for body in range(root + 1, compiled.nbody):
            if compiled.body_parentid[body] in inside:
                inside.append(body)
        held = cls(model, root, tuple(inside))
        held._check_is_rigid(place)
        return held

    def inertia(self, place: str) -> Inertia:
        """Return the mass properties in the body's frame; raise ``ScenarioError`` without mass or extent."""
        with np.errstate(all="ignore"):
            whole = self._inertia_of(self.model.compiled)
            if whole is None:
                refuse_scenario(
                    place,
                    f"body {self._name!r} has no mass: give its shapes a density or a mass; in a URDF file, give its "
                    f"links an <inertial> with a mass above 0, or a <collision>",
                )
            is_solid = np.all(np.isfinite(whole.tensor)) and np.all(np.linalg.eigvalsh(whole.pseudo_inertia()) > 0.0)
        if not np.all(np.isfinite(whole.barycentric())):
            refuse_scenario(
                place,
                f"body {self._name!r} has infinite mass properties; expected finite masses and lengths",
            )
        if not is_solid:
            refuse_scenario(
                place, f"a body of {whole.mass:g} kg with such moments of inertia has no extent in some direction"
            )
        return whole

    def extent(self, properties: MassProperties) -> Extent:
        """Return the extent of its shapes, or, if it has none, of a box with its mass properties."""
        shapes = [triangles for _, triangles in self._shapes()]
        return Extent.around(np.concatenate(shapes).reshape(-1, 3)) if shapes else Extent.like(properties)

    def surface(self) -> Array:
        """Return triangles of its shapes in its frame, shape (n, 3, 3) [m]; of its visual shapes, if it has any."""
        shapes = dict(self._shapes())
        touches = self.model.compiled.geom_contype | self.model.compiled.geom_conaffinity
        looks = [triangles for geom, triangles in shapes.items() if not touches[geom]]
        parts = looks or list(shapes.values())
        return np.concatenate(parts) if parts else np.empty((0, 3, 3))

    def _shapes(self) -> Iterator[tuple[int, Array]]:
        """Yield the numbers of its bounded shapes, and their triangles in its frame, shape (n, 3, 3) [m]."""
        import mujoco

        model, placed = self.model.compiled, _placed(self.model.compiled)
        unbounded = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)
        for geom in range(model.ngeom):
            kind = mujoco.mjtGeom(model.geom_type[geom])  # no number is among mujoco's enumerators
            if model.geom_bodyid[geom] in self.inside and kind not in unbounded:
                pose = self._on_root(placed, placed.geom_xmat[geom], placed.geom_xpos[geom])
                yield geom, _triangles(model, geom) @ pose.rotation.T + pose.translation

    def grasps(self, names: Sequence[str], extent: Extent, place: str) -> tuple[Grasp, ...]:
        """Return sites that are fixed to it, as grasps in its frame.

        A site that is not there, named twice, the only one, or far outside of the body is a ``ScenarioError``.
        """
        model, placed = self.model.compiled, _placed(self.model.compiled)
        named = {model.site(site).name: site for site in range(model.nsite) if model.site(site).name}
        sites = {name: site for name, site in named.items() if model.site_bodyid[site] in self.inside}
        elsewhere = {
            name: model.body(model.site_bodyid[site]).name for name, site in named.items() if name not in sites
        }
        grasps = []
        for count, name in enumerate(names):
            if name in names[:count]:
                refuse_scenario(place, f"found {name!r} twice, but expected a site of its own for each robot")
            if name not in sites:
                where = f", but {elsewhere[name]!r}, which is not held" if name in elsewhere else ""
                refuse_scenario(
                    place, f"found {name!r}, but body {self._name!r} has no such site{where}; it has: {_listed(sites)}"
                )
            pose = self._on_root(placed, placed.site_xmat[sites[name]], placed.site_xpos[sites[name]])
            if complaint := extent.complaint(pose.translation):
                refuse_scenario(place, f"site {name!r} {complaint}")
            grasps.append(Grasp(vector_of(pose.translation), vector_of(np.degrees(rotation_log(pose.rotation)))))
        if len(names) == 1:
            refuse_scenario(place, f"found {names[0]!r} alone, expected at least 2: each robot grasps one")
        return tuple(grasps)

    def remark_doubts(self, place: str, whole: Inertia) -> None:
        """Log what may not be meant: mass that MuJoCo chooses or changes, shapes with mass, fillings of meshes."""
        given = self._inertia_of(self.model.variant(self.inside, leave_out_defaults))
        chosen = whole.mass - (given.mass if given is not None else 0.0)
        if chosen > _SMALL_SHARE * whole.mass:
            LOG.warning(
                f"coheft: {place}: {chosen:.4g} kg of {whole.mass:.4g} kg are of shapes of {DEFAULT_DENSITY:g} kg/m³, "
                f"with which MuJoCo fills them if a file gives neither mass nor density: give one, unless that is meant"
            )
        written = self._inertia_of(self.model.variant(self.inside, keep_what_is_written))
        if written is None or not _alike(whole, written):
            LOG.warning(
                f"coheft: {place}: boundmass, boundinertia, balanceinertia or settotalmass of its compiler change its "
                f"mass properties: they are not those in the file"
            )
        solid = self._inertia_of(self.model.variant(self.inside, leave_out_looks))
        looks = whole.mass - solid.mass if solid is not None else 0.0
        if looks > _SMALL_SHARE * whole.mass:
            LOG.warning(
                f"coheft: {place}: {looks:.4g} kg of {whole.mass:.4g} kg, {looks / whole.mass:.0%}, are of shapes that "
                f"collide with nothing (contype and conaffinity 0); if they are there for their looks only, give them "
                f"mass = 0"
            )
        self._remark_welds(place)
        self._remark_shapes(place)

    def _remark_welds(self, place: str) -> None:
        """Write to the log which bodies with joints equality constraints weld to it: they are not held."""
        import mujoco

        model, others = self.model.compiled, set[int]()
        for weld in np.flatnonzero((model.eq_type == mujoco.mjtEq.mjEQ_WELD) & (model.eq_active0 != 0)):
            ends = {int(model.eq_obj1id[weld]), int(model.eq_obj2id[weld])}
            if model.eq_objtype[weld] == mujoco.mjtObj.mjOBJ_SITE:
                ends = {int(model.site_bodyid[site]) for site in ends}
            if ends & {*self.inside}:
                others |= ends - {*self.inside}
        moving = [body for body in sorted(others) if model.body_weldid[body] != 0]
        names = [model.body(body).name for body in moving if model.body_mocapid[model.body_weldid[body]] < 0]
        if names:
            LOG.warning(
                f"coheft: {place}: an equality constraint welds {_listed(names)} to it, which is left out: only what "
                f"is inside of body {self._name!r} is held; put it there, if that is meant"
            )

    def _remark_shapes(self, place: str) -> None:
        """Write to the log which of the shapes that have mass are not closed, not filled exactly, or overlap."""
        import mujoco

        model = self.model.compiled
        rules = {mesh.id: mesh.inertia for mesh in self.model.spec.meshes}
        solid, meshes = [], np.zeros(2)
        for geom, triangles in self._shapes():
            if geom not in self.model.weighing:
                continue
            if mujoco.mjtGeom(model.geom_type[geom]) in (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF):
                try:
                    check_surface(triangles, f"{place}: mesh {model.mesh(model.geom_dataid[geom]).name!r}")
                except ScenarioError as error:
                    LOG.warning(f"coheft: {error}; MuJoCo fills it all the same, so that its mass may be wrong")
                    continue
                meshes += _filled(_triangles(model, geom), rules[model.geom_dataid[geom]]), _volume(triangles)
            if model.geom_contype[geom] or model.geom_conaffinity[geom]:
                solid.append(triangles)
        filled, exact = meshes
        if abs(filled - exact) > _SMALL_DIFFERENCE * exact:
            LOG.warning(
                f"coheft: {place}: MuJoCo fills meshes by a rule that is exact for convex ones only, which makes "
                f"{filled:.4g} m³; up to their surfaces there would be {exact:.4g} m³ with another centre of mass and "
                f"other moments of inertia, as 'payload.mesh' has it: give these meshes inertia=\"exact\", or join "
                f"their shells, if that is meant"
            )
        twice, where = overlap_of(solid, np.concatenate(solid)) if solid else (0.0, None)
        volume = sum(_volume(shape) for shape in solid)
        if where is not None and twice > _SMALL_DIFFERENCE * volume:
            LOG.warning(
                f"coheft: {place}: shapes overlap, {where}: about {twice / volume:.1%} of their volume is counted "
                f"twice, as MuJoCo does; if some are for collisions only, give them mass = 0"
            )

    @property
    def _name(self) -> str:
        name: str = self.model.compiled.body(self.root).name
        return name

    def _check_is_rigid(self, place: str) -> None:
        """Check that no body below it moves against it."""
        import mujoco

        model = self.model.compiled
        expected = "expected one rigid body, which may have a free joint, but none of another kind and none inside"
        for joint in range(model.njnt):
            kind, body = mujoco.mjtJoint(model.jnt_type[joint]), model.jnt_bodyid[joint]
            if body in self.inside and not (body == self.root and kind == mujoco.mjtJoint.mjJNT_FREE):
                what = f"{model.joint(joint).name or 'without a name'}, {kind.name.removeprefix('mjJNT_').lower()}"
                refuse_scenario(place, f"body {self._name!r} has a joint ({what}): {expected}")
        for body in self.model.floating:
            if body in self.inside and body != self.root:
                other = model.body(body).name
                refuse_scenario(place, f"body {self._name!r} has a free joint, of {other!r} below it: {expected}")

    def _inertia_of(self, model: mujoco.MjModel | None) -> Inertia | None:
        """Return the mass properties by a variant of the model, in the body's frame; None without any mass."""
        if model is None:
            return None
        placed = _placed(model)
        parts = [
            Inertia(float(model.body_mass[body]), np.zeros(3), np.diag(model.body_inertia[body])).transported(
                self._on_root(placed, placed.ximat[body], placed.xipos[body])
            )
            for body in self.inside
            if model.body_mass[body] > 0.0
        ]
        return combined(parts) if parts else None

    def _on_root(self, placed: mujoco.MjData, rotation: Array, position: Array) -> Pose:
        """Return a part's pose in the body's frame, from its rotation matrix (9,) and position (3,) in the world."""
        root = Pose(placed.xmat[self.root].reshape(3, 3), placed.xpos[self.root])
        return root.inverse() @ Pose(rotation.reshape(3, 3), position)


def _placed(model: mujoco.MjModel) -> mujoco.MjData:
    """Return the poses of all parts of a model in the world, as in its file."""
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return data


def _triangles(model: mujoco.MjModel, geom: int) -> Array:
    """Return the triangles of one shape in its own frame, shape (n, 3, 3) [m]."""
    import mujoco
    import trimesh

    make, size = trimesh.creation, np.array(model.geom_size[geom])
    match mujoco.mjtGeom(model.geom_type[geom]):
        case mujoco.mjtGeom.mjGEOM_MESH | mujoco.mjtGeom.mjGEOM_SDF:
            mesh = model.geom_dataid[geom]
            faces = model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]
            shape = trimesh.Trimesh(model.mesh_vert[model.mesh_vertadr[mesh] :], faces, process=False)
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            shape = make.icosphere(2, size[0])
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            shape = make.icosphere(2).apply_scale(size)
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            shape = make.capsule(2.0 * size[1], size[0], count=(8, 16))
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            shape = make.cylinder(size[0], 2.0 * size[1], sections=16)
        case _:  # a box, or else the one around it
            middle, halves = np.array(model.geom_aabb[geom]).reshape(2, 3)
            shape = make.box(2.0 * halves).apply_translation(middle)
    return np.array(shape.triangles, dtype=np.float64)


def _volume(triangles: Array) -> float:
    """Return the volume inside of a closed surface of triangles (n, 3, 3) [m³]."""
    return float(np.linalg.det(triangles - triangles.mean(axis=(0, 1))).sum()) / 6.0


def _filled(triangles: Array, rule: mujoco.mjtMeshInertia) -> float:
    """Return the volume that MuJoCo finds in a mesh [m³], whose triangles (n, 3, 3) are in its own frame."""
    import mujoco
    import trimesh

    if rule == mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX:
        return float(trimesh.convex.convex_hull(triangles.reshape(-1, 3)).volume)
    volumes = np.linalg.det(triangles) / 6.0  # of pyramids with the centre of mass as their tip
    return float((np.abs(volumes) if rule == mujoco.mjtMeshInertia.mjMESH_INERTIA_LEGACY else volumes).sum())


def _alike(one: Inertia, other: Inertia) -> bool:
    """Whether two bodies weigh the same, and turn alike about their centres of mass."""
    moments = np.linalg.eigvalsh(one.tensor), np.linalg.eigvalsh(other.tensor)
    return bool(
        abs(one.mass - other.mass) < _SMALL_DIFFERENCE * one.mass
        and np.allclose(*moments, rtol=_SMALL_DIFFERENCE, atol=0.0)
    )


def _listed(names: Iterable[str]) -> str:
    known = list(names)
    return ", ".join(known[:_NAMES_SHOWN] + ["..."] * (len(known) > _NAMES_SHOWN)) or "none"

"""Loads that are put onto the payload and taken away while it moves."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import mujoco
import numpy as np

from coheft.errors import LoadError
from coheft.estimation.geometry.spatial import Array, Pose, rotation_from_quaternion
from coheft.estimation.rigid_body.mass_properties import Inertia, combined
from coheft.wire.messages.truth import LoadState
from coheft.wire.scenario.payload import MassProperties
from coheft.wire.scenario.payload_extent import Extent, corners
from coheft.wire.scenario.section import Vector
from coheft.wire.scenario.strength import Strength

_LOAD_COLOUR = (0.85, 0.35, 0.15, 1.0)


def _slot_name(slot: int) -> str:
    return f"slot{slot}"


def add_slots(payload: mujoco.MjsBody, count: int) -> None:
    """Add massless, invisible bodies fixed to the payload, each of which can become a load later.

    Editing a slot's mass, place and inertia is exact: the engine derives nothing from them when it compiles, while
    an edit of the payload's own body would need its inertia frame to be derived anew.
    """
    for slot in range(count):
        body = payload.add_body(name=_slot_name(slot))
        body.add_geom(
            name=_slot_name(slot),
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[0.05, 0.05, 0.05],
            mass=0.0,
            rgba=[0.0, 0.0, 0.0, 0.0],
            contype=0,
            conaffinity=0,
        )


class Loads:
    """The loads on the payload; edits the running simulation.

    Loads are homogeneous boxes in the axes of the payload's frame, numbered from 1 as they come.

    Attributes:
        inertia: Mass properties of payload and loads together, in the payload's frame.
    """

    inertia: Inertia

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, payload_body: int, payload: Inertia, slots: int):
        self._model = model
        self._data = data
        self._payload_body = payload_body
        self._payload = payload
        self._extent = _extent(model, payload_body, payload)
        self._slots: list[LoadState | None] = [None] * slots
        self._next_id = 1
        self.inertia = payload

    @property
    def states(self) -> list[LoadState]:
        """Loads that lie on the payload, oldest first."""
        return sorted((load for load in self._slots if load is not None), key=lambda load: load.id)

    @property
    def slots_free(self) -> int:
        """How many more loads the payload can take."""
        return self._slots.count(None)

    def put(
        self, mass: float, position: Vector, size: Vector, leak: float = 0.0, strength: Strength | None = None
    ) -> LoadState:
        """Fix a load, at rest in the world until then, to the moving payload.

        The impact keeps the momentum of all that moves, but for the impulses ``z`` with which welds (Jacobian ``J``)
        keep hands on the payload: ``M_new v_new = M_old v_old + J^T z`` and ``J v_new = 0``, with the generalised
        velocity ``v`` and inertia ``M``.

        Args:
            mass: [kg].
            position: Of its centre in the payload's frame [m].
            size: Its edge lengths [m].
            leak: What it loses [kg/s], see ``leak``.
            strength: Of the arms that hold the payload; None: they hold everything.

        Raises:
            LoadError: There can be no such load, or no slot is free, or the arms cannot hold it up.
        """
        _check(mass, position, size, leak)
        complaint = self._extent.complaint(position)
        if complaint:
            raise LoadError(f"position of a load is {tuple(position)} m, which {complaint}")
        complaint = self._extent.size_complaint(size)
        if complaint:
            raise LoadError(f"size of a load is {tuple(size)} m, which {complaint}")
        if not self.slots_free:
            raise LoadError(
                f"all {len(self._slots)} load slots of the payload are taken: remove one of the loads "
                f"{_ids(self.states)}, or give the scenario more 'payload.load_slots'"
            )
        load = LoadState(self._next_id, float(mass), _vector(position), _vector(size), float(leak))
        with np.errstate(over="ignore", invalid="ignore"):
            together = combined([self.inertia, _inertia_of(load)]).spatial()
        if not np.isfinite(together).all():
            raise LoadError(f"inertia of a load of {mass} kg at {tuple(position)} m overflows: give smaller numbers")
        complaint = strength.complaint(_inertia_of(load), self.inertia) if strength is not None else ""
        if complaint:
            raise LoadError(f"mass of a load is {mass:g} kg at {tuple(position)} m, which is {complaint}")
        momentum = self._momentum()
        self._next_id += 1
        self._fill(self._slots.index(None), load)
        self._set_momentum(momentum)
        return load

    def take(self, load_id: int) -> LoadState:
        """Let a load go. The twist of the payload stays: the load leaves with the velocity that it has.

        Raises:
            LoadError: There is no such load.
        """
        for slot, load in enumerate(self._slots):
            if load is not None and load.id == load_id:
                self._fill(slot, None)
                return load
        there = f"the loads are {_ids(self.states)}" if self.states else "there are no loads"
        raise LoadError(f"there is no load {load_id}: {there}")

    def leak(self, duration: float) -> None:
        """Let all loads lose what leaks out of them in that time [s], down to nothing.

        As in ``take``, the twist of the payload stays: what leaves keeps the velocity that it has. The rest is a
        homogeneous box of the same size. An empty load keeps its slot until it is taken away.
        """
        for slot, load in enumerate(self._slots):
            if load is not None and load.leak > 0.0 and load.mass > 0.0:
                self._fill(slot, msgspec.structs.replace(load, mass=max(0.0, load.mass - load.leak * duration)))

    def _momentum(self) -> Array:
        """Generalised momentum, shape (nv,)."""
        model, data = self._model, self._data
        mujoco.mj_fwdPosition(model, data)  # until then the engine knows the state before its last step
        momentum = np.empty(model.nv)
        mujoco.mj_mulM(model, data, momentum, data.qvel)
        return momentum

    def _set_momentum(self, momentum: Array) -> None:
        """Set the velocities that a generalised momentum (nv,) and the impulses of welds lead to."""
        model, data = self._model, self._data
        mujoco.mj_fwdPosition(model, data)
        jacobian = np.empty((data.nefc, model.nv))
        for row, unit in zip(jacobian, np.eye(data.nefc), strict=True):
            mujoco.mj_mulJacTVec(model, data, row, unit)
        # Rows: how velocities follow from the momentum, then from each weld's impulse.
        velocities = np.empty((1 + data.nefc, model.nv))
        mujoco.mj_solveM(model, data, velocities, np.vstack([momentum, jacobian]))
        free, by_impulse = velocities[0], velocities[1:]
        data.qvel[:] = free - np.linalg.solve(jacobian @ by_impulse.T, jacobian @ free) @ by_impulse

    def _fill(self, slot: int, load: LoadState | None) -> None:
        """Put a load, or nothing, into a slot, here and in the engine's model."""
        self._slots[slot] = load
        self.inertia = combined([self._payload, *map(_inertia_of, self.states)])
        model = self._model
        body, geom = model.body(_slot_name(slot)).id, model.geom(_slot_name(slot)).id
        if load is None:
            model.body_mass[body] = 0.0
            model.body_inertia[body] = 0.0
            model.geom_rgba[geom] = 0.0
        else:
            model.body_mass[body] = load.mass
            model.body_inertia[body] = np.diag(Inertia.of_box(load.mass, load.size, Pose.identity()).tensor)
            model.body_pos[body] = load.position
            model.geom_size[geom] = np.array(load.size) / 2.0
            model.geom_rbound[geom] = np.linalg.norm(model.geom_size[geom])
            model.geom_rgba[geom] = _LOAD_COLOUR
        model.body_subtreemass[body] = model.body_mass[body]
        slots = [model.body(_slot_name(number)).id for number in range(len(self._slots))]
        model.body_subtreemass[self._payload_body] = model.body_mass[[self._payload_body, *slots]].sum()
        model.body_subtreemass[0] = model.body_mass.sum()


def _inertia_of(load: LoadState) -> Inertia:
    """Mass properties of a load in the payload's frame."""
    return Inertia.of_box(load.mass, load.size, Pose(np.eye(3), np.array(load.position)))


def _extent(model: mujoco.MjModel, body: int, payload: Inertia) -> Extent:
    """Of the boxes that a payload is made of, or else of a box with its mass properties, as scenarios are checked."""
    geoms = np.flatnonzero(model.geom_bodyid == body)
    if not geoms.size:
        return Extent.like(MassProperties.of(payload))
    poses = (Pose(rotation_from_quaternion(model.geom_quat[geom]), model.geom_pos[geom]) for geom in geoms)
    boxes = zip(poses, 2.0 * model.geom_size[geoms], strict=True)
    return Extent.around(np.concatenate([corners(pose, size) for pose, size in boxes]))


def _check(mass: float, position: Vector, size: Vector, leak: float) -> None:
    if not (math.isfinite(mass) and mass > 0.0):
        raise LoadError(f"mass of a load is {mass} kg but expected a finite number greater than 0")
    if len(position) != 3 or not all(map(math.isfinite, position)):
        raise LoadError(f"position of a load is {tuple(position)} m but expected three finite numbers")
    if len(size) != 3 or not all(math.isfinite(edge) and edge > 0.0 for edge in size):
        raise LoadError(f"size of a load is {tuple(size)} m but expected three finite numbers greater than 0")
    if not (math.isfinite(leak) and leak >= 0.0):
        raise LoadError(f"leak of a load is {leak} kg/s but expected a finite number not below 0")


def _vector(values: Sequence[float]) -> Vector:
    x, y, z = map(float, values)
    return x, y, z


def _ids(loads: Sequence[LoadState]) -> str:
    return ", ".join(str(load.id) for load in loads)

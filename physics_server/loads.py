"""Loads that are added to the payload and removed while it moves."""

import math
from collections.abc import Sequence

import msgspec
import mujoco
import numpy as np

from coheft.errors import LoadError
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.mass_properties import Inertia, combined
from coheft.wire.messages.truth import LoadState
from coheft.wire.scenario.payload import Payload, vector_of
from coheft.wire.scenario.payload_extent import extent_of
from coheft.wire.scenario.section import Vector
from coheft.wire.scenario.strength import Strength

_LOAD_COLOUR = (0.85, 0.35, 0.15, 1.0)


def _slot_name(slot: int) -> str:
    return f"slot{slot}"


def add_slots(payload: mujoco.MjsBody, count: int) -> None:
    """Add massless, invisible bodies fixed to the payload, each of which can become a load later.

    Editing mass, position and inertia of such a slot is exact. Editing the payload's own body would require the engine
    to derive its inertia frame again.
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
    """The loads on the payload. Changes edit the running simulation.

    Loads are homogeneous boxes with the axes of the payload's frame, numbered from 1 in the order in which they are
    added.

    Attributes:
        inertia: Mass properties of the payload with its loads, in the payload's frame.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, payload_body: int, payload: Payload) -> None:
        self._model = model
        self._data = data
        self._payload_body = payload_body
        self._payload = self.inertia = payload.inertia()
        self._extent = extent_of(payload)
        self._slots: list[LoadState | None] = [None] * payload.load_slots
        self._next_id = 1

    @property
    def states(self) -> list[LoadState]:
        """The loads on the payload, oldest first."""
        return sorted((load for load in self._slots if load is not None), key=lambda load: load.id)

    @property
    def slots_free(self) -> int:
        """Number of loads that can still be added."""
        return self._slots.count(None)

    def put(
        self, mass: float, position: Vector, size: Vector, leak: float = 0.0, strength: Strength | None = None
    ) -> LoadState:
        """Attach a load that was at rest in the world to the moving payload.

        The impact conserves the generalized momentum, apart from the impulses ``z`` of the welds (Jacobian ``J``) that
        keep the hands on the payload: ``M_new v_new = M_old v_old + J^T z`` and ``J v_new = 0``, with the generalized
        velocity ``v`` and the mass matrix ``M``.

        Args:
            mass: Mass [kg].
            position: Position of its centre in the payload's frame [m].
            size: Its edge lengths [m].
            leak: Rate at which it loses mass [kg/s], see ``leak``.
            strength: Strength of the arms that hold the payload; None if it is unlimited.

        Raises:
            LoadError: The load is invalid, no slot is free, or the arms cannot hold it.
        """
        _check(mass, position, size, leak)
        if complaint := self._extent.complaint(position):
            raise LoadError(f"position of a load is {tuple(position)} m, which {complaint}")
        if complaint := self._extent.size_complaint(size):
            raise LoadError(f"size of a load is {tuple(size)} m, which {complaint}")
        if not self.slots_free:
            raise LoadError(
                f"all {len(self._slots)} load slots of the payload are in use: remove one of the loads "
                f"{_ids(self.states)}, or increase the scenario's 'payload.load_slots'"
            )
        place, edges = (vector_of(np.array(each, dtype=np.float64)) for each in (position, size))
        load = LoadState(self._next_id, float(mass), place, edges, float(leak))
        with np.errstate(over="ignore", invalid="ignore"):
            together = combined([self.inertia, _inertia_of(load)]).spatial()
        if not np.isfinite(together).all():
            raise LoadError(f"inertia of a load of {mass} kg at {tuple(position)} m overflows: use smaller numbers")
        if strength is not None and (complaint := strength.complaint(_inertia_of(load), self.inertia)):
            raise LoadError(f"mass of a load is {mass:g} kg at {tuple(position)} m, which is {complaint}")
        momentum = self._momentum()
        self._next_id += 1
        self._fill(self._slots.index(None), load)
        self._set_momentum(momentum)
        return load

    def take(self, load_id: int) -> LoadState:
        """Remove a load, or raise a ``LoadError``; the payload keeps its twist: the load leaves with its velocity."""
        for slot, load in enumerate(self._slots):
            if load is not None and load.id == load_id:
                self._fill(slot, None)
                return load
        available = f"the loads are {_ids(self.states)}" if self.states else "there are no loads"
        raise LoadError(f"there is no load {load_id}: {available}")

    def leak(self, duration: float) -> None:
        """Reduce all loads by what leaks out of them in ``duration`` [s], down to zero.

        As in ``take``, the payload keeps its twist. The rest of a load is a homogeneous box of the same size. An empty
        load keeps its slot until it is removed.
        """
        for slot, load in enumerate(self._slots):
            if load is not None and load.leak > 0.0 and load.mass > 0.0:
                self._fill(slot, msgspec.structs.replace(load, mass=max(0.0, load.mass - load.leak * duration)))

    def _momentum(self) -> Array:
        """Return the generalized momentum, shape (nv,)."""
        model, data = self._model, self._data
        mujoco.mj_fwdPosition(model, data)  # the engine's derived quantities are from before its last step
        momentum = np.empty(model.nv)
        mujoco.mj_mulM(model, data, momentum, data.qvel)
        return momentum

    def _set_momentum(self, momentum: Array) -> None:
        """Set the velocities that result from a generalized momentum (nv,) and the impulses of the welds."""
        model, data = self._model, self._data
        mujoco.mj_fwdPosition(model, data)
        jacobian = np.empty((data.nefc, model.nv))
        for row, unit in zip(jacobian, np.eye(data.nefc), strict=True):
            mujoco.mj_mulJacTVec(model, data, row, unit)
        # First row: velocities due to the momentum; then one row per weld impulse.
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
    """Return a load's mass properties in the payload's frame."""
    return Inertia.of_box(load.mass, load.size, Pose(np.eye(3), np.array(load.position)))


def _check(mass: float, position: Vector, size: Vector, leak: float) -> None:
    if not (math.isfinite(mass) and mass > 0.0):
        raise LoadError(f"mass of a load is {mass} kg but expected a finite number greater than 0")
    if len(position) != 3 or not all(map(math.isfinite, position)):
        raise LoadError(f"position of a load is {tuple(position)} m but expected three finite numbers")
    if len(size) != 3 or not all(math.isfinite(edge) and edge > 0.0 for edge in size):
        raise LoadError(f"size of a load is {tuple(size)} m but expected three finite numbers greater than 0")
    if not (math.isfinite(leak) and leak >= 0.0):
        raise LoadError(f"leak of a load is {leak} kg/s but expected a finite number not below 0")


def _ids(loads: Sequence[LoadState]) -> str:
    return ", ".join(str(load.id) for load in loads)

"""A cart in MuJoCo: a rigid body in the plane, pushed at its handle, whose wheels do not slip sideways.

The wheels' force is computed exactly from the engine's mass matrix and acceleration, with a term that removes slip due
to rounding. Rolling wheels with friction would slip a thousand times as much.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from coheft.errors import SimulationError
from coheft.estimation.cart.contact import MOVING, grasp_map
from coheft.estimation.cart.load import change_of_phi
from coheft.estimation.cart.model import CartBody, axes, mass_matrix, resistance, wheel_row
from coheft.estimation.geometry.spatial import Array
from coheft.wire.cart.messages import CartMeasurement, CartPush, CartTruth
from coheft.wire.cart.scenario import PHYSICS_RATE, CartLoad, CartScenario
from coheft.wire.scenario.borders import by_border

_STABILISING = 100.0
"""Rate at which residual slip decays [1/s]."""
_CASTER_TRAIL = 0.03
"""Distance from a caster's swivel to its point of contact with the floor [m]."""
_CASTER_DRAG = 15.0
"""Drag of casters that are perpendicular to the motion [N]."""
_CASTER_PLAY = 0.05
"""Smallest angle between a caster and the direction of motion [rad]."""
_FARTHEST = 1e3
_MASS = "mass"


@dataclass(frozen=True, eq=False)
class CartSample:
    """Measurements and truth at one sample."""

    measurements: dict[str, CartMeasurement]
    truth: CartTruth


class Casters:
    """Casters that trail behind their swivels, and turn round when the cart changes direction.

    ``psi' = -(v / trail) sin psi``: 0 is stable in forward motion, pi in backward motion. In between, they cause drag.
    """

    def __init__(self) -> None:
        self._angle = _CASTER_PLAY

    def drag(self, speed: float, duration: float) -> float:
        """Return the force along the cart's x axis [N], and advance the casters by ``duration`` [s]."""
        self._angle -= speed / _CASTER_TRAIL * math.sin(self._angle) * duration
        self._angle = min(max(self._angle, _CASTER_PLAY), math.pi - _CASTER_PLAY)
        across = math.sin(self._angle) - math.sin(_CASTER_PLAY)
        return -_CASTER_DRAG * across * math.tanh(speed / 0.01)


class CartSimulation:
    """A cart and the hands on its handle.

    The same scenario and the same pushes give the same numbers, bit for bit.

    Attributes:
        block: Index of the next sample.
        model, data: The engine's model and state, for views.
    """

    def __init__(self, scenario: CartScenario) -> None:
        self._scenario = scenario
        self.block = 0
        self._cart = scenario.cart
        self.model = _build(scenario.cart)
        self.data = mujoco.MjData(self.model)
        self._steps = PHYSICS_RATE // scenario.rate
        self._acceleration = np.zeros(3)
        self._casters = Casters() if scenario.casters else None
        self._loads = by_border(scenario.loads, 1.0 / scenario.rate)
        self._hands = {name: np.array(scenario.hand(name)) for name in scenario.names}
        self._rng = np.random.default_rng(scenario.seed)

    def advance(self, pushes: Mapping[str, CartPush]) -> CartSample:
        """Advance to the next sample with the pushes of the hands until then; a missing hand exerts no wrench.

        It raises a ``SimulationError`` if the cart has moved out of bounds.
        """
        for load in self._loads.get(self.block, ()):
            self._change(load)
        scenario, motion = self._scenario, np.concatenate([self.data.qpos, self.data.qvel])
        if not (np.abs(motion) < _FARTHEST).all():
            raise SimulationError(f"at {self.block / scenario.rate:g} s the cart has moved out of bounds: {motion}")
        wrench_b, squares = np.zeros(3), 0.0
        for name, push in pushes.items():
            self._hands[name] = push.hand
            wrench_b += grasp_map(push.hand) @ push.wrench
            squares += float(np.sum(np.square(push.wrench / [1.0, 1.0, scenario.arm])))
        truth = CartTruth(
            block=self.block,
            time=self.block / scenario.rate,
            cart=self._cart,
            motion=motion,
            wrench=wrench_b,
            effort=math.sqrt(squares),
            slip=float(wheel_row(motion[2]) @ motion[3:]),
        )
        measurements = {name: self._measure(name, motion, pushes.get(name)) for name in scenario.names}
        for _ in range(self._steps):
            self._step(wrench_b)
        self.block += 1
        return CartSample(measurements, truth)

    def _measure(self, name: str, motion: Array, push: CartPush | None) -> CartMeasurement:
        noise = self._rng.standard_normal(9)
        wrench = np.zeros(3) if push is None else push.wrench
        sensor = self._scenario.force_noise * np.array([1.0, 1.0, self._scenario.arm])
        return CartMeasurement(
            robot=name,
            block=self.block,
            motion=motion + self._scenario.noise * self._scenario.noise_factor * noise[:6],
            wrench=wrench + sensor * noise[6:],
            hand=self._hands[name],
        )

    def _step(self, wrench_b: Array) -> None:
        """Advance by one step of the midpoint rule; the wrench rotates with the cart, as hands do.

        The engine's integrators do not include the wheels' constraint. Euler's method would bias the estimates: it
        makes the moment of inertia appear one per cent smaller.
        """
        data, model = self.data, self.model
        duration = model.opt.timestep
        position, velocity = data.qpos.copy(), data.qvel.copy()
        data.qpos += 0.5 * duration * velocity
        data.qvel += 0.5 * duration * self._acceleration  # of the previous step
        self._acceleration = self._rolling(wrench_b)
        data.qvel[:] = velocity + duration * self._acceleration
        data.qpos[:] = position + 0.5 * duration * (velocity + data.qvel)
        data.time += duration

    def _rolling(self, wrench_b: Array) -> Array:
        """Return the acceleration (3,) at the engine's present state, with all forces."""
        data, model = self.data, self.model
        theta, rates = float(data.qpos[2]), data.qvel
        to_floor = axes(theta)
        speed = float(to_floor[:, 0] @ rates)
        if self._casters is not None:
            wrench_b = wrench_b + [self._casters.drag(speed, model.opt.timestep), 0.0, 0.0]
        data.qfrc_applied[:] = to_floor @ wrench_b - resistance(self._cart.friction, rates)
        mujoco.mj_forward(model, data)
        row, by_row = wheel_row(theta), np.empty((1, 3))
        mujoco.mj_solveM(model, data, by_row, np.array([row]))
        slipping = float(row @ data.qacc) - float(rates[2]) * speed + _STABILISING * float(row @ rates)
        result: Array = data.qacc - slipping / float(row @ by_row[0]) * by_row[0]
        return result

    def _change(self, load: CartLoad) -> None:
        """Add or remove a load; one that is added was at rest, and momentum along free directions is conserved."""
        old, new = self._cart, with_load(self._cart, load)
        if load.mass > 0.0:
            theta = float(self.data.qpos[2])
            to_floor = axes(theta)[:, MOVING]
            motion = to_floor.T @ self.data.qvel
            self.data.qvel[:] = to_floor @ np.linalg.solve(_moving_mass(new), _moving_mass(old) @ motion)
        self._cart = new
        _set_mass(self.model, self._cart)


def with_load(body: CartBody, load: CartLoad) -> CartBody:
    """Return the cart with a load added, or removed if the load's mass is negative."""
    length, width = load.size
    gyration = (length**2 + width**2) / 12.0
    return CartBody.of(body.phi + change_of_phi(np.array([load.mass, *load.place, gyration])), body.friction)


def _moving_mass(body: CartBody) -> Array:
    """Return the mass matrix (2, 2) of forward motion and rotation."""
    return mass_matrix(body.phi, 0.0)[np.ix_(MOVING, MOVING)]


def _build(cart: CartBody) -> mujoco.MjModel:
    """Build a model with two slides and a hinge, without collisions."""
    spec = mujoco.MjSpec()
    spec.option.timestep = 1.0 / PHYSICS_RATE
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_AUTORESET
    body = spec.worldbody.add_body(name="cart")
    for axis in ([1, 0, 0], [0, 1, 0]):
        body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.45, 0.3, 0.2], pos=[0.2, 0.0, 0.5], mass=0.0, contype=0, conaffinity=0
    )
    # All mass is in a separate body, fixed to the cart, so that it can be edited at any time.
    body.add_body(name=_MASS, mass=1.0, inertia=[1.0, 1.0, 1.0], explicitinertial=True)
    model = spec.compile()
    _set_mass(model, cart)
    return model


def _set_mass(model: mujoco.MjModel, cart: CartBody) -> None:
    body = model.body(_MASS).id
    model.body_mass[body] = cart.mass
    model.body_pos[body, :2] = cart.com
    model.body_inertia[body] = cart.inertia
    model.body_subtreemass[:] = cart.mass

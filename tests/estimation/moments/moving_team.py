"""Rows of robots that hold one moving rigid body: exact ones, and what sensors with noise and errors make of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pytest

from coheft.estimation.geometry.body_motion import BODY_A, BODY_ALPHA, BODY_W, grasp_measurements
from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.moments.body import BodyModel
from coheft.estimation.moments.rows import ROW_SIZE, RowNoise
from coheft.estimation.moments.sensor_errors import SensorErrors
from coheft.estimation.moments.unknowns import State, Unknowns
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.estimation.rigid_body.regressor import symmetric_products
from tests.estimation.team import body_motion, smooth

PERIOD = 0.02
NOISE = RowNoise.of_samples(SensorNoise(), samples=10, rate=500.0)
EXACT = SensorErrors({})
ERRORS = SensorErrors({"acceleration_bias": 0.1, "velocity_gain": 0.02, "gyro_scale": 0.01, "force_cross_talk": 0.01})
LATE = SensorErrors({"acceleration_bias": 0.1, "gyro_mounting": 0.01, "clock": 0.002, "wrench_delay": 0.002})
"""Errors that depend on how fast rows change."""
LIMP = SensorErrors({"acceleration_bias": 0.1, "velocity_scale": 0.01, "force_scale": 0.01, "grasp_compliance": 1e-4})
LATE_AND_LIMP = SensorErrors(LATE.tolerances[0] | {"grasp_compliance": 1e-4})
"""And on how fast forces change."""
EVERY = pytest.mark.parametrize(
    "errors", [EXACT, ERRORS, LATE, LIMP, LATE_AND_LIMP], ids=["exact", "errors", "late", "limp", "late and limp"]
)


def carried_load(load: Array, pose: Pose) -> Array:
    """``(wrench offset, theta)``, known in ``F_j``, seen from ``F_i``, with ``pose`` that of ``F_j`` in ``F_i``."""
    theta = Inertia.from_barycentric(load[6:]).transported(pose).barycentric()
    return np.concatenate([pose.adjoint() @ load[:6], theta])


@dataclass(frozen=True, eq=False)
class Team:
    """A team and n rows.

    Attributes:
        poses: Of all grasps in the body frame.
        motion: ``(w, v, a, alpha)`` of the body frame, shape (n, 12).
        load: ``(wrench offset, theta)``, shape (16,).
        wrenches: Of each robot in its own frame, shape (n, N, 6).
    """

    poses: tuple[Pose, ...]
    motion: Array
    load: Array
    wrenches: Array

    @property
    def count(self) -> int:
        return len(self.poses)

    @property
    def psi(self) -> Array:
        """``(1, w, v, a, alpha, products of w)``, shape (n, 19)."""
        return np.hstack([np.ones((len(self.motion), 1)), self.motion, symmetric_products(self.motion[:, BODY_W])])

    @property
    def total_wrench(self) -> Array:
        """Without the offset, shape (n, 6)."""
        parts = (self.motion[:, part] for part in (BODY_W, BODY_A, BODY_ALPHA))
        return Inertia.from_barycentric(self.load[6:]).wrench(*parts)

    def rows_with(self, gyros: Array) -> Array:
        """Exact rows (n, 24 N + 1), but for an angular velocity that all read in excess, in the body frame (3,)."""
        read = self.motion.copy()
        read[:, BODY_W] += gyros
        by_robot = []
        for i, pose in enumerate(self.poses):
            true, excessive = grasp_measurements(pose, self.motion), grasp_measurements(pose, read)
            slope = self.motion[:, BODY_ALPHA] @ pose.rotation
            products = symmetric_products(excessive[:, :3])
            by_robot.append(np.hstack([excessive[:, :6], true[:, 6:], slope, self.wrenches[:, i], products]))
        return np.hstack([*by_robot, np.ones((len(read), 1))])

    @cached_property
    def rows(self) -> Array:
        """Exact rows, shape (n, 24 N + 1)."""
        return self.rows_with(np.zeros(3))

    def noisy(self, rng: np.random.Generator, noise: RowNoise = NOISE) -> Array:
        """Rows with noise, shape (n, 24 N + 1)."""
        rows = self.rows.copy()
        own = rows[:, :-1].reshape(len(rows), self.count, ROW_SIZE)
        own[..., :12] += rng.normal(size=own[..., :12].shape) * noise.kinematics
        own[..., 12:18] += rng.normal(size=own[..., 12:18].shape) * noise.wrench
        own[..., 18:] = symmetric_products(own[..., :3].reshape(-1, 3)).reshape(*own.shape[:2], 6)
        own[..., 18:21] -= noise.kinematics[:, :1] ** 2
        return rows

    def state(self, errors: SensorErrors = EXACT) -> State:
        """The true one, with exact sensors."""
        return State.first(self.poses, errors).with_load(self.load)

    def expressed_in(self, frame: Pose) -> Team:
        """The same, but ``frame``, given in the body frame, is the body frame."""
        inside = frame.inverse()
        kinematics = grasp_measurements(frame, self.motion)
        motion = np.hstack([kinematics, self.motion[:, BODY_ALPHA] @ frame.rotation])
        return replace(
            self, poses=tuple(inside @ p for p in self.poses), motion=motion, load=carried_load(self.load, inside)
        )

    def permuted(self, order: Sequence[int]) -> Team:
        """The robots in another order, or some of them."""
        return replace(self, poses=tuple(self.poses[i] for i in order), wrenches=self.wrenches[:, order])

    def holding(self, load: Array, rows: slice = slice(None)) -> Team:
        """Another load in some of the rows; the first robot carries the difference."""
        other = replace(self, load=load)
        more = other.total_wrench + load[:6] - self.total_wrench - self.load[:6]
        wrenches = self.wrenches.copy()
        wrenches[rows, 0] += (more @ self.poses[0].inverse().adjoint().T)[rows]
        return replace(self, load=load, wrenches=wrenches)


def make_team(
    seed: int,
    count: int = 3,
    number: int = 100,
    turning: float = 0.3,
    moving: float = 0.1,
    single_axis: bool = False,
    on_a_line: bool = False,
    offset: float = 0.0,
) -> Team:
    """Robots on a rim around a load of some 20 kg; the body frame is somewhere in it."""
    rng = np.random.default_rng(seed)
    time = PERIOD * np.arange(number)
    rim = 2.0 * np.pi * np.arange(count) / count + rng.uniform(0.0, 2.0 * np.pi)
    positions = np.stack([0.55 * np.cos(rim), 0.4 * np.sin(rim), rng.uniform(-0.1, 0.1, count)], axis=1)
    if on_a_line:
        positions = np.linspace(-0.6, 0.6, count)[:, None] * np.array([0.8, 0.6, 0.0])
    poses = tuple(Pose(rotation_exp(rng.normal(size=3)), position) for position in positions)
    tensor = np.diag(rng.uniform(1.0, 2.0, 3)) + 0.1
    inertia = Inertia(rng.uniform(15.0, 25.0), 0.05 * rng.normal(size=3), tensor)
    load = np.concatenate([offset * rng.normal(size=6) * np.repeat([1.0, 0.1], 3), inertia.barycentric()])
    motion = body_motion(rng, time, turning, moving, single_axis)
    team = Team(poses, motion, load, np.zeros((number, count, 6)))
    missing = team.total_wrench + load[:6]
    for i in range(1, count):
        share = missing[:, :3] @ poses[i].rotation / count
        pushes = smooth(rng, time, 10.0)[0], smooth(rng, time, 1.0)[0]
        team.wrenches[:, i] = np.hstack([share + pushes[0], pushes[1]])
        missing = missing - team.wrenches[:, i] @ poses[i].adjoint().T
    team.wrenches[:, 0] = missing @ poses[0].inverse().adjoint().T
    return team


def with_rates(rows: Array) -> Array:
    """All rows (n, 24 N + 1) but the first and the last one, each with its rates, shape (n - 2, 48 N + 1)."""
    return np.hstack([rows[1:-1], (rows[2:, :-1] - rows[:-2, :-1]) / (2.0 * PERIOD)])


def flexing_of(rows: Array) -> Array:
    """How fast forces change in axes that do not turn, from exact rows (n, 24 N + 1), shape (n, N, 6)."""
    own = rows[:, :-1].reshape(len(rows), -1, ROW_SIZE)
    w, force = own[..., :3], own[..., 12:15]
    first = np.gradient(force, PERIOD, axis=0) + np.cross(w, force)
    return np.concatenate([first, np.gradient(first, PERIOD, axis=0) + np.cross(w, first)], axis=2)


def noisy_for(errors: SensorErrors, team: Team, rng: np.random.Generator, noise: RowNoise = NOISE) -> Array:
    """Rows with noise, and with what follows them, of independent noise, if these errors need it."""
    rows = team.noisy(rng, noise)
    extended = extended_for(errors, team.rows)
    extended[:, : rows.shape[1]] = rows[1:-1] if errors.has_rates else rows
    more = extended[:, rows.shape[1] :].reshape(len(extended), team.count, errors.more)
    if errors.has_rates:
        deviations = noise.rates * np.hstack([noise.kinematics, noise.wrench])
        more[..., :18] += rng.normal(size=more[..., :18].shape) * deviations
    if errors.is_flexing:
        deviations = noise.flexing * noise.wrench[:, [0, 1, 2, 0, 1, 2]]
        more[..., -6:] += rng.normal(size=more[..., -6:].shape) * deviations
    return extended


def by_robot(extended: Array, count: int) -> Array:
    """Extended rows of each robot, shape (n, N, width)."""
    one, number = ROW_SIZE * count, len(extended)
    parts = [extended[:, :one].reshape(number, count, ROW_SIZE), np.ones((number, count, 1))]
    if extended.shape[1] > one + 1:
        parts.append(extended[:, one + 1 :].reshape(number, count, -1))
    return np.concatenate(parts, axis=2)


def misread(extended: Array, state: State) -> Array:
    """What sensors with the errors of a state read where exact ones would read these rows."""
    count = len(state.poses)
    if state.calibration is None:
        return extended
    true = by_robot(extended, count)
    read = np.einsum("nij,tnj->tni", np.linalg.inv(state.calibration), true)
    one, number = ROW_SIZE * count, len(extended)
    parts = [read[:, :, :ROW_SIZE].reshape(number, one), extended[:, one : one + 1]]
    if true.shape[2] > ROW_SIZE + 1:
        parts.append(read[:, :, ROW_SIZE + 1 :].reshape(number, -1))
    return np.hstack(parts)


def body_at(state: State, errors: SensorErrors = EXACT, noise: RowNoise = NOISE) -> BodyModel:
    return BodyModel(state, noise, Unknowns(len(state.poses), errors))


def extended_for(errors: SensorErrors, rows: Array) -> Array:
    """Rows (n, 24 N + 1) with what follows them, if these errors need it; then those with rates are fewer."""
    extended, inner = (with_rates(rows), slice(1, -1)) if errors.has_rates else (rows.copy(), slice(None))
    if not errors.is_flexing:
        return extended
    flexing, size = flexing_of(rows)[inner], rows.shape[1]
    rates = extended[:, size:].reshape(*flexing.shape[:2], -1)
    more = np.concatenate([rates, flexing], axis=2).reshape(len(extended), -1)
    return np.hstack([extended[:, :size], more])


def with_errors(team: Team, errors: SensorErrors, rng: np.random.Generator, gyros: float = 0.01) -> tuple[State, Array]:
    """The true state with random errors of the sensors, and exact rows as they are read then."""
    state, unknowns = team.state(errors), Unknowns(team.count, errors)
    step = np.zeros(unknowns.size)
    step[unknowns.eta] = errors.deviations * rng.normal(size=(team.count, errors.count))
    step[unknowns.gyros] = gyros * rng.normal(size=3)
    state = state.moved(step, unknowns, farthest=6.0)
    return state, misread(extended_for(errors, team.rows_with(state.gyros)), state)


def uneven_noise(count: int) -> RowNoise:
    """Of robots of which each has other sensors; that of rates and of flexing is left out."""
    factors = np.linspace(0.5, 2.0, count)[:, None]
    return RowNoise(factors * NOISE.kinematics, factors[::-1] * NOISE.wrench)

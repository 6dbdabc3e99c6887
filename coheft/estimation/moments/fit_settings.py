"""Assumptions of a fit: noise of rows, declared errors of sensors, and prior deviations of all unknowns.

offset of the total wrench = sum_i Ad(g_i) offset_i,    gyro offset of the fused motion = mean of the robots' offsets
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.linear_algebra import inverse as inverse_of
from coheft.estimation.moments import rows
from coheft.estimation.moments.body import FORCING, BodyModel
from coheft.estimation.moments.evidence import Evidence
from coheft.estimation.moments.moments import Moments
from coheft.estimation.moments.rows import RowNoise
from coheft.estimation.moments.sensor_errors import SensorErrors
from coheft.estimation.moments.unknowns import OFFSET, Indices, State, Unknowns
from coheft.estimation.rigid_body.mass_properties import point_mass
from coheft.estimation.rigid_body.unobservable import middle_and_size
from coheft.estimation.tolerance import SensorDrift

POSE_LIMITS: Array = np.repeat([np.radians(5.0), 0.1], 3)
"""A pose is hidden in directions in which its deviation is larger [rad, m]: up to this, steps are nearly linear."""
_EXACT = 1e-9
"""Standard deviation of an error that is not declared."""
_LEVER = 1e-5
"""Least offset of torques per offset of forces [m]: about a line through all grasps, forces alone make none."""
_WIDE = 2.0
"""A sensor error is hidden where its deviation is more than so many prior deviations; with the prior it never is."""
_LIGHTEST = 1e-3
"""Least mass of a guess [kg]."""


@dataclass(frozen=True, eq=False)
class Guess:
    """A rough guess of the load, each part of it uncertain by 100 %.

    Attributes:
        theta: ``(m, m h, I_o)`` in the body frame, shape (10,).
        limits: Its standard deviations, shape (10,).
        size: Rough size of the load [m].
    """

    theta: Array
    limits: Array
    size: float

    @staticmethod
    def of(body: BodyModel, moments: Moments) -> Guess:
        """Guess the mass from the mean wrench and acceleration, and the centre of mass in the middle of the grasps."""
        middle, size = middle_and_size(body.state.poses)
        sums = moments.sums(body.one)
        number = sums[body.one]
        force, acceleration = body.wrench_map[:3] @ sums / number, body.motion_map[FORCING[1:4]] @ sums / number
        mass = max(_LIGHTEST, float(np.linalg.norm(force)) / max(float(np.linalg.norm(acceleration)), 1e-9))
        theta = mass * point_mass(middle)
        theta[4:7] += mass * size**2 / 3.0
        return Guess.about(theta, size)

    @staticmethod
    def about(theta: Array, size: float) -> Guess:
        """Guess ``theta``, with the deviations of a body of this mass and size [m]."""
        return Guess(theta, theta[0] * np.repeat([1.0, size, size**2], [1, 3, 6]), size)


@dataclass(frozen=True, eq=False)
class FitSettings:
    """Settings of all fits of one robot.

    Attributes:
        noise: Noise of rows.
        period: Duration of a row [s].
        errors: Declared errors of sensors.
        force_offset, torque_offset: Standard deviations of the constant offsets of one robot's sensors, per axis
            [N, N·m]; 0 if they have none; of each robot, shape (N,), if they differ.
        gyro_offset: The same of its gyro [rad/s].
        drift: Drift of these offsets and of accelerometers.
        memory: Time constant over which the load is forgotten [s]; None: never.
    """

    noise: RowNoise
    period: float
    errors: SensorErrors = field(default_factory=lambda: SensorErrors({}))
    force_offset: float | Array = 0.0
    torque_offset: float | Array = 0.0
    gyro_offset: float | Array = 0.0
    drift: SensorDrift = field(default_factory=SensorDrift)
    memory: float | None = None

    @cached_property
    def has_offset(self) -> bool:
        """Whether force and torque sensors may have offsets."""
        return bool(np.max(self.force_offset) > 0.0 or np.max(self.torque_offset) > 0.0)

    @cached_property
    def has_gyro_offset(self) -> bool:
        """Whether gyros may have offsets."""
        return bool(np.max(self.gyro_offset) > 0.0)

    @property
    def anchor(self) -> int:
        """Index of the robot whose pose best fixes the body frame at first: the first of those that miss the fewest
        motion sensors, and of these have the best gyros.
        """
        kinematics = self.noise.kinematics
        return int(np.lexsort((kinematics[:, rows.W.start], np.isinf(kinematics).sum(axis=1)))[0])

    def body(self, state: State) -> BodyModel:
        """Compute the matrices at a state."""
        return BodyModel(state, self.noise, Unknowns(len(state.poses), self.errors))

    def limits(self, count: int, guess: Guess) -> Array:
        """Return deviations (u,) beyond which an unknown counts as hidden, for a team of ``count`` robots."""
        force = max(np.max(self.force_offset), _EXACT) * np.sqrt(count)
        torque = max(np.max(self.torque_offset), _EXACT) * np.sqrt(count) + 2.0 * guess.size * force
        errors = np.broadcast_to(_WIDE * self.errors.deviations, (count, self.errors.count))
        own = np.hstack([np.tile(POSE_LIMITS, (count, 1)), errors])
        gyros = np.full(3, _WIDE * max(np.max(self.gyro_offset), _EXACT))
        return np.concatenate([own.ravel(), gyros, _WIDE * np.repeat([force, torque], 3), guess.limits])

    def free(self, unknowns: Unknowns, anchor: int, with_load: bool) -> Indices:
        """Indices of the unknowns that a fit changes."""
        is_free = np.ones(unknowns.size, dtype=bool)
        is_free[unknowns.poses[anchor]] = False
        is_free[unknowns.eta[anchor, self.errors.are("clock")]] = False  # one offset of all clocks has no effect
        is_free[unknowns.eta[unknowns.deviations == 0.0]] = False
        is_free[unknowns.offset], is_free[unknowns.gyros] = self.has_offset, self.has_gyro_offset
        if not with_load:
            is_free[unknowns.gyros.start :] = False
            is_free[unknowns.eta] = False
        return np.flatnonzero(is_free)

    def expected(self, body: BodyModel) -> Evidence:
        """Return the prior of sensor errors and offsets, as evidence around the state of ``body``."""
        unknowns, state = body.unknowns, body.state
        offset = np.zeros(6) if state.load is None else state.load[OFFSET]
        total = Evidence.of_information(inverse_of(self.offset_covariance(body)), -offset)
        total = total.embedded(unknowns.size, unknowns.offset)
        gyros = np.full(3, self.fused_gyro_offset(body))
        total += Evidence.prior(gyros, -state.gyros).embedded(unknowns.size, unknowns.gyros)
        return total + expected_errors(unknowns, state.eta) if unknowns.deviations.any() else total

    def fused_gyro_offset(self, body: BodyModel) -> float:
        """Prior deviation of the offset of the fused angular velocity, robots weighed by their shares [rad/s]."""
        own = np.maximum(self.gyro_offset, _EXACT)
        return float(np.linalg.norm(body.shares * own) if np.ndim(own) else own / np.sqrt(self._fused(body)))

    def _fused(self, body: BodyModel) -> float:
        """Number of robots of which the mean would be as exact as the fused angular velocity."""
        return body.count if len(self.noise.kinematics) == 1 else float(1.0 / np.square(body.shares).sum())

    def offset_covariance(self, body: BodyModel) -> Array:
        """Prior covariance (6, 6) of the total wrench's offset."""
        least_torque = max(_EXACT, _LEVER * float(np.max(self.force_offset)))
        return _of_total(body, np.maximum(self.force_offset, _EXACT), np.maximum(self.torque_offset, least_torque))

    def offset_variances(self, robots: Sequence[int], guess: Guess) -> Array:
        """Variances (6,) that the wrench offsets of these robots add to the total wrench's, anywhere on the load."""
        torque = self.torque_offset + 2.0 * guess.size * self.force_offset
        each = np.broadcast_arrays(self.force_offset, torque)
        return np.repeat([np.square(own[robots]).sum() if own.ndim else len(robots) * own**2 for own in each], 3)

    @property
    def steady(self) -> float:
        """Time over which drift stays below half of a mean's noise [s], ``inf`` without drift.

        A random walk of variance ``d^2 t`` differs from its own mean by a third of that; noise averages out:
        ``d^2 t / 3 = s^2 T / (4 t)``.
        """
        kinematics, wrench = self.noise.kinematics.min(axis=0), self.noise.wrench.min(axis=0)
        each = (
            (kinematics[rows.W.start], self.drift.gyro),
            (kinematics[rows.A.start], self.drift.acceleration),
            (wrench[0], self.drift.force),
            (wrench[3], self.drift.torque),
        )
        return min(
            (math.sqrt(0.75 * 60.0 * self.period) * float(noise) / drift for noise, drift in each if drift > 0.0),
            default=math.inf,
        )

    def drifted_kinematics(self, seconds: float) -> Array:
        """Variances of the drift of ``(w, v, a, slope)`` in a time [s] over those of the noise, shape of the latter."""
        drift = np.zeros(rows.KINEMATICS_SIZE)
        drift[rows.W], drift[rows.A] = self.drift.gyro, self.drift.acceleration
        return seconds / 60.0 * np.square(drift / self.noise.kinematics)

    def drifted_wrench(self, body: BodyModel, seconds: float) -> Array:
        """Covariance (6, 6) of the drift of the total wrench's offset in a time [s]."""
        return seconds / 60.0 * _of_total(body, self.drift.force, self.drift.torque)

    def drifted(self, body: BodyModel, seconds: float) -> tuple[Indices, Array]:
        """Return indices (k,) of the unknowns that drift, and the covariance (k, k) of their drift in a time [s]."""
        unknowns, drift, minutes = body.unknowns, self.drift, seconds / 60.0
        is_bias = self.errors.are("acceleration_bias")
        parts = [
            (np.arange(unknowns.size)[unknowns.offset], _of_total(body, drift.force, drift.torque)),
            (np.arange(unknowns.size)[unknowns.gyros], drift.gyro**2 / self._fused(body) * np.eye(3)),
            (unknowns.eta[:, is_bias].ravel(), drift.acceleration**2 * np.eye(unknowns.count * int(is_bias.sum()))),
        ]
        parts = [(indices, covariance) for indices, covariance in parts if covariance.any()]
        size = sum(len(indices) for indices, _ in parts)
        result, first = np.zeros((size, size)), 0
        for indices, covariance in parts:
            own = slice(first, first + len(indices))
            result[own, own], first = minutes * covariance + _EXACT**2 * np.eye(len(indices)), own.stop
        return np.concatenate([indices for indices, _ in parts]), result


def expected_errors(unknowns: Unknowns, eta: Array, robots: slice | Sequence[int] = slice(None)) -> Evidence:
    """Return the prior of the sensor errors of some robots as evidence, around these errors of all, shape (N, q)."""
    deviations = unknowns.deviations[robots]
    is_declared = deviations > 0.0
    expected = Evidence.prior(deviations[is_declared], -eta[robots][is_declared])
    return expected.embedded(unknowns.size, unknowns.eta[robots][is_declared])


def _of_total(body: BodyModel, force: float | Array, torque: float | Array) -> Array:
    """Covariance (6, 6) of the total wrench, about the body frame, for these deviations of each robot's wrench."""
    force, torque = np.broadcast_arrays(force, torque)
    spread = np.repeat(np.stack([force**2, torque**2], axis=-1), 3, axis=-1)
    result: Array = (body.adjoints * spread[..., None, :] @ body.adjoints.swapaxes(1, 2)).sum(axis=0)
    return result

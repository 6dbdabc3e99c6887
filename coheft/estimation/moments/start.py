"""A first state in closed form, from moments alone.

R_ij = argmax tr(R_ij^T K),    K = sum w_i w_j^T / sigma_w^2 + ... + mean a_i (mean a_j)^T    (Wahba 1965)
p_ij from  v_j = R_ij^T (v_i + w_i x p_ij)

``K`` is the attitude profile matrix (Markley 1988), and Davenport's q-method (1968) gives its rotation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from coheft.estimation.geometry.spatial import CROSS_OF_AXES, Array, Pose, rotation_from_quaternion
from coheft.estimation.moments import rows
from coheft.estimation.moments.body import CENTRIPETAL_OF_AXES, MOTION_SIZE, A, BodyModel, V, W
from coheft.estimation.moments.derivatives import MotionDerivatives, WrenchDerivatives
from coheft.estimation.moments.evidence import Evidence
from coheft.estimation.moments.fit import EvaluateMoments, fit_state
from coheft.estimation.moments.fit_settings import POSE_LIMITS, FitSettings, Guess
from coheft.estimation.moments.likelihood import wrench_evidence
from coheft.estimation.moments.moments import RowMoments, WrenchMoments
from coheft.estimation.moments.rows import ROW_SIZE
from coheft.estimation.moments.unknowns import Flags, State

_TURNING = slice(10, MOTION_SIZE)
"""Entries of the motion by which accelerations differ from place to place on the body: ``(alpha, products of w)``."""
_WEAK = 1e-9
"""Regularization, as a share of the noise: keeps the velocity solvable if nothing rotates."""
_TIE_BREAK = 1e-12
"""Makes no rotation the likeliest one where the moments are all zero."""
_UNKNOWN = 1e3
"""Variance of a part of the motion that no robot measures; some are larger, none of those that one measures is."""
_LEVER_TERMS = np.concatenate([CROSS_OF_AXES, CENTRIPETAL_OF_AXES.transpose(2, 1, 0)])
"""``alpha x p + w x (w x p) == sum_k motion[_TURNING][k] _LEVER_TERMS[k] @ p``, shape (9, 3, 3)."""


def first_poses(moments: RowMoments, known: State, settings: FitSettings, is_unknown: Flags) -> State:
    """Compute unknown poses, each from the motion sensors of that robot and the motion of those whose pose is known, at
    least one.

    Robots that have no sensor in common with these, but with others, come later: then the others' poses are known.
    ``is_unknown`` (N,) says which poses are unknown.
    """
    left, has = is_unknown.copy(), np.isfinite(settings.noise.kinematics[:, [rows.V.start, rows.A.start]])
    has = np.broadcast_to(has, (len(left), 2))
    while left.any():
        motion = _Motion(moments, known, settings, left)
        shares = left & (has & has[~left].any(axis=0)).any(axis=1)
        found = shares if shares.any() else left
        poses = [motion.first_pose(robot) if found[robot] else pose for robot, pose in enumerate(known.poses)]
        known, left = replace(known, poses=tuple(poses)), left & ~found
    return known


class _Sensor(NamedTuple):
    """A motion sensor of one robot.

    Attributes:
        entries: Its entries in the rows of all robots.
        variance: Mean of the variances of its noise and of that of the motion; the latter alone if it is missing.
        is_there: Whether the robot has it.
    """

    entries: slice
    variance: float
    is_there: bool


class _Motion:
    """Moments of the motion that robots with known poses measure, and of all rows; other robots are ``is_unknown``
    (N,).
    """

    def __init__(self, moments: RowMoments, known: State, settings: FitSettings, is_unknown: Flags) -> None:
        count = len(known.poses)
        of_all = np.broadcast_to(settings.noise.kinematics, (count, rows.KINEMATICS_SIZE))
        noise = replace(settings.noise, kinematics=np.where(is_unknown[:, None], np.inf, of_all))
        body = replace(settings, noise=noise).body(known)
        one = body.one
        fused, noise_of_motion = body.motion_map[:MOTION_SIZE], body.motion_noise[:MOTION_SIZE, :MOTION_SIZE]
        self._of_rows = moments.matrix @ fused.T
        self._of_motion = fused @ self._of_rows
        self._number = number = float(moments.matrix[one, one])
        self._mean_row, self._mean = moments.matrix[one] / number, self._of_rows[one] / number
        self._noise, self._deviations = number * noise_of_motion, of_all
        # Moments of the motion with itself, and with the rows of all robots, less those of their means.
        self._varied = self._of_motion - number * np.outer(self._mean, self._mean)
        self._varied_with = self._of_rows.T - number * np.outer(self._mean, self._mean_row)
        accelerations = np.arange(one).reshape(count, ROW_SIZE)[:, rows.A].ravel()
        spread = moments.matrix[accelerations, accelerations] - number * np.square(self._mean_row[accelerations])
        self._swaying = float(spread.sum()) / count  # sum of squared deviations of accelerations from their mean

    def _unexplained(self, part: slice, entries: slice, by: slice, weak: float) -> Array:
        """Moments of a part of the motion with a part of the row, less what another part explains.

        ``M_pe - M_pb (M_bb + weak I)^-1 M_be``: the lever arm, an unknown factor of that part, has no effect on them.
        """
        square = self._varied[by, by]
        explained = np.linalg.solve(square + weak * np.eye(len(square)), self._varied_with[by, entries])
        return self._varied_with[part, entries] - self._varied[part, by] @ explained

    def first_pose(self, robot: int) -> Pose:
        """Compute a robot's pose: its rotation, then its position from velocities or, without these, accelerations."""
        gyro, velocity = self._sensor(robot, W, rows.W), self._sensor(robot, V, rows.V)
        accelerometer = self._sensor(robot, A, rows.A)
        has_velocity = velocity.is_there and self._noise[V.start, V.start] / self._number < _UNKNOWN
        profile = self._attitude_profile(gyro, velocity, accelerometer)
        if not (gyro.is_there and has_velocity):
            profile += self._profile_by_varied_acceleration(accelerometer)
        rotation = _likeliest_rotation(profile)
        if has_velocity:
            return Pose(rotation, self._position_by_velocity(rotation, gyro, velocity))
        return Pose(rotation, self._position_by_acceleration(rotation, accelerometer))

    def _sensor(self, robot: int, part: slice, sensor: slice) -> _Sensor:
        first, of_motion = ROW_SIZE * robot, self._noise[part.start, part.start] / self._number
        own = self._deviations[robot, sensor.start] ** 2
        is_there = bool(np.isfinite(own))
        variance = float(0.5 * (of_motion + own) if is_there else of_motion)
        return _Sensor(slice(first + sensor.start, first + sensor.stop), variance, is_there)

    def _attitude_profile(self, gyro: _Sensor, velocity: _Sensor, accelerometer: _Sensor) -> Array:
        """Attitude profile matrix ``K`` by gyros, velocities and gravity, which is the mean acceleration: (3, 3)."""
        profile = 0.5 * self._varied_with[W, gyro.entries] / gyro.variance
        by_velocity = self._unexplained(V, velocity.entries, W, _WEAK * gyro.variance)
        profile += 0.5 * by_velocity / velocity.variance
        gravity = np.outer(self._mean[A], self._mean_row[accelerometer.entries])
        profile += self._number**2 / (self._swaying + accelerometer.variance) * gravity
        return profile

    def _profile_by_varied_acceleration(self, accelerometer: _Sensor) -> Array:
        """Attitude profile matrix by deviations of accelerations from their mean, shape (3, 3)."""
        variance = accelerometer.variance
        weak = _WEAK * self._varied[_TURNING, _TURNING].trace() + _WEAK * self._number * variance
        return 0.5 * self._unexplained(A, accelerometer.entries, _TURNING, weak) / variance

    def _position_by_velocity(self, rotation: Array, gyro: _Sensor, velocity: _Sensor) -> Array:
        """Compute the position from ``R v_i = v + w x p``, shape (3,).

        ``sum (|w|^2 I - w w^T) p = sum w x (v - R v_i)``, with a weak pull to zero where the motion does not show it.
        """
        square = self._varied[W, W]
        pull = 2.0 * self._number * gyro.variance + 2.0 * velocity.variance / POSE_LIMITS[3] ** 2
        moment = self._varied[W, V] - self._varied_with[W, velocity.entries] @ rotation.T
        crossed = (moment.T - moment)[[2, 0, 1], [1, 2, 0]]
        return np.linalg.solve((np.trace(square) + pull) * np.eye(3) - square, crossed)

    def _position_by_acceleration(self, rotation: Array, accelerometer: _Sensor) -> Array:
        """Compute the position from ``R a_i = a + alpha x p + w x (w x p)``, shape (3,)."""
        square = (self._of_motion - self._noise)[_TURNING, _TURNING]
        spread = np.einsum("kab,kl,lac->bc", _LEVER_TERMS, square, _LEVER_TERMS)
        more = (
            self._of_rows[accelerometer.entries, _TURNING].T @ rotation.T - (self._of_motion - self._noise)[_TURNING, A]
        )
        values, vectors = np.linalg.eigh(spread)
        values = np.maximum(values, 0.0) + accelerometer.variance / POSE_LIMITS[3] ** 2
        result: Array = vectors @ (vectors.T @ np.einsum("kab,ka->b", _LEVER_TERMS, more) / values)
        return result


def poses_by_motion(
    state: State,
    is_unknown: Flags,
    kept: RowMoments,
    evaluate: EvaluateMoments,
    prior: Callable[[BodyModel], Evidence],
    settings: FitSettings,
    anchor: int,
) -> State:
    """Return the state without a load, its unknown poses computed in closed form from ``kept`` moments, then fitted to
    the motion alone, for which see ``fit_state``.
    """
    state = first_poses(kept, state, settings, is_unknown).with_load(None)
    guess = Guess.of(settings.body(state), kept)
    return fit_state(state, evaluate, prior, guess, settings, anchor).state


def _likeliest_rotation(profile: Array) -> Array:
    """Return the rotation ``R`` that maximizes ``tr(R^T K)`` for a profile ``K`` (3, 3) (Davenport's q-method)."""
    trace, skewed = np.trace(profile), profile - profile.T
    davenport = np.zeros((4, 4))
    davenport[0, 0] = trace + _TIE_BREAK
    davenport[0, 1:] = davenport[1:, 0] = skewed[2, 1], skewed[0, 2], skewed[1, 0]
    davenport[1:, 1:] = profile + profile.T - trace * np.eye(3)
    return rotation_from_quaternion(np.linalg.eigh(davenport)[1][:, -1])


def first_load(state: State, moments: WrenchMoments, guess: Guess, settings: FitSettings) -> State:
    """Return the state with wrench offset and load by least squares at its poses, from moments of wrenches there."""
    load = np.concatenate([np.zeros(6), guess.theta])
    body = settings.body(state.with_load(load))
    unknowns = body.unknowns
    total = wrench_evidence(body, WrenchDerivatives.at(body, MotionDerivatives.at(body)), moments) + settings.expected(
        body
    )
    which = np.arange(unknowns.size)[unknowns.load if settings.has_offset else unknowns.theta]
    part = total.restricted(which)
    inverse = part.solve(settings.limits(unknowns.count, guess)[which]).inverse
    load[-len(which) :] += inverse @ part.score
    return state.with_load(load)

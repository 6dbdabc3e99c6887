"""A first state in closed form, from moments alone.

R_ij = argmax tr(R_ij^T K),    K = sum w_i w_j^T / sigma_w^2 + ... + mean a_i (mean a_j)^T         (Davenport 1968)
p_ij from  v_j = R_ij^T (v_i + w_i x p_ij)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from coheft.estimation.geometry.spatial import CROSS_OF_AXES, Array, Pose, rotation_from_quaternion
from coheft.estimation.moments import rows
from coheft.estimation.moments.body import CENTRIPETAL_OF_AXES, MOTION_SIZE, A, BodyModel, V, W
from coheft.estimation.moments.derivatives import MotionDerivatives
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
_FAINT = 1e-12
"""Makes no rotation the likeliest one where the moments are all zero."""
_UNKNOWN = 1e3
"""Variance of a part of the motion that no robot measures; some are larger, none of those that one measures is."""
_LEVER_TERMS = np.concatenate([CROSS_OF_AXES, CENTRIPETAL_OF_AXES.transpose(2, 1, 0)])
"""``alpha x p + w x (w x p) == sum_k motion[_TURNING][k] _LEVER_TERMS[k] @ p``, shape (9, 3, 3)."""


def first_poses(moments: RowMoments, known: State, settings: FitSettings, is_unknown: Flags) -> State:
    """Compute unknown poses, each from the motion sensors of that robot and the motion of those whose pose is known.

    Robots that have no sensor in common with these, but with others, come later: then the others' poses are known.

    Args:
        moments: Moments of rows.
        known: A state with the poses of all other robots, of one at least.
        settings: Settings of the fit.
        is_unknown: Whether each robot's pose is unknown, shape (N,).
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


class _Motion:
    """Moments of the motion that robots with known poses measure, and of all rows.

    Args:
        moments: Moments of rows.
        known: A state with the poses of these robots.
        settings: Settings of the fit.
        is_unknown: Whether each robot's pose is unknown, shape (N,).
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
        self._noise, self._variances = number * noise_of_motion, np.square(of_all)
        accelerations = np.arange(one).reshape(count, ROW_SIZE)[:, rows.A].ravel()
        spread = moments.matrix[accelerations, accelerations] - number * np.square(self._mean_row[accelerations])
        self._swaying = float(spread.sum()) / count  # sum of squared deviations of accelerations from their mean

    def _varied(self, part: slice, other: slice) -> Array:
        """Moments of parts of the motion with each other, less those of their means."""
        result: Array = self._of_motion[part, other] - self._number * np.outer(self._mean[part], self._mean[other])
        return result

    def _varied_with(self, part: slice, entries: slice) -> Array:
        """Moments of a part of the motion with a part of the row of all robots, less those of their means."""
        means = np.outer(self._mean[part], self._mean_row[entries])
        result: Array = self._of_rows[entries, part].T - self._number * means
        return result

    def first_pose(self, robot: int) -> Pose:
        """Compute a robot's pose."""
        first, own = ROW_SIZE * robot, np.sqrt(self._variances[robot])
        slices = {part.start: slice(first + part.start, first + part.stop) for part in (rows.W, rows.V, rows.A)}
        w, v, a = (slices[part.start] for part in (rows.W, rows.V, rows.A))
        of_motion = self._noise.diagonal() / self._number

        def variance(part: slice, sensor: slice) -> float:
            """Of the noise of a sensor, mean of the robot's and that of the motion; the latter alone if it has none."""
            both = of_motion[part.start], own[sensor.start] ** 2
            return float(0.5 * (both[0] + both[1]) if np.isfinite(both[1]) else both[0])

        gyro, velocity, acceleration = variance(W, rows.W), variance(V, rows.V), variance(A, rows.A)
        turning = self._varied(W, W)
        by_turning = np.linalg.solve(turning + _WEAK * gyro * np.eye(3), self._varied_with(W, v))
        likeness = 0.5 * self._varied_with(W, w) / gyro
        likeness += 0.5 * (self._varied_with(V, v) - self._varied(V, W) @ by_turning) / velocity
        # On average every accelerometer measures gravity alone.
        gravity = np.outer(self._mean[A], self._mean_row[a])
        likeness += self._number**2 / (self._swaying + acceleration) * gravity
        has_twist = np.isfinite(own[rows.TWIST]).all() and of_motion[V.start] < _UNKNOWN
        if not has_twist:
            turned = self._varied(_TURNING, _TURNING)
            weak = _WEAK * np.trace(turned) + _WEAK * self._number * acceleration
            by_lever = np.linalg.solve(turned + weak * np.eye(len(turned)), self._varied_with(_TURNING, a))
            likeness += 0.5 * (self._varied_with(A, a) - self._varied(A, _TURNING) @ by_lever) / acceleration
        rotation = _likeliest_rotation(likeness)
        if np.isinf(own[rows.V.start]) or of_motion[V.start] >= _UNKNOWN:
            return Pose(rotation, self._position_by_acceleration(rotation, a, acceleration))
        # A weak pull to zero holds the position where the motion does not show it.
        pull = 2.0 * self._number * gyro + 2.0 * velocity / POSE_LIMITS[3] ** 2
        moment = self._varied(W, V) - self._varied_with(W, v) @ rotation.T
        turned = (moment.T - moment)[[2, 0, 1], [1, 2, 0]]
        spread = (np.trace(turning) + pull) * np.eye(3) - turning
        return Pose(rotation, np.linalg.solve(spread, turned))

    def _position_by_acceleration(self, rotation: Array, entries: slice, variance: float) -> Array:
        """Compute where an accelerometer is from ``R a_i = a + alpha x p + w x (w x p)``, shape (3,)."""
        square = (self._of_motion - self._noise)[_TURNING, _TURNING]
        spread = np.einsum("kab,kl,lac->bc", _LEVER_TERMS, square, _LEVER_TERMS)
        more = self._of_rows[entries, _TURNING].T @ rotation.T - (self._of_motion - self._noise)[_TURNING, A]
        values, vectors = np.linalg.eigh(spread)
        values = np.maximum(values, 0.0) + variance / POSE_LIMITS[3] ** 2
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
    """Return the state without a load, its unknown poses computed in closed form, then fitted to the motion alone.

    Args:
        state: A state with the known poses.
        is_unknown: Whether each robot's pose is unknown, shape (N,).
        kept: Moments of rows for the closed form.
        evaluate: Moments that are fitted to, at a state.
        prior: Prior evidence at a state.
        settings: Settings of the fit.
        anchor: Index of the robot whose pose stays fixed.
    """
    state = first_poses(kept, state, settings, is_unknown).with_load(None)
    guess = Guess.of(settings.body(state), kept)
    return fit_state(state, evaluate, prior, guess, settings, anchor).state


def _likeliest_rotation(likeness: Array) -> Array:
    """Return the rotation ``R`` that maximizes ``tr(R^T K)`` for a matrix ``K`` (3, 3) (Davenport's q-method)."""
    trace, skewed = np.trace(likeness), likeness - likeness.T
    davenport = np.zeros((4, 4))
    davenport[0, 0] = trace + _FAINT
    davenport[0, 1:] = davenport[1:, 0] = skewed[2, 1], skewed[0, 2], skewed[1, 0]
    davenport[1:, 1:] = likeness + likeness.T - trace * np.eye(3)
    return rotation_from_quaternion(np.linalg.eigh(davenport)[1][:, -1])


def first_load(state: State, moments: WrenchMoments, guess: Guess, settings: FitSettings) -> State:
    """Return the state with wrench offset and load by least squares at its poses.

    Args:
        state: The state with poses and sensor errors.
        moments: Moments of wrenches at this state.
        guess: Guess of theta.
        settings: Settings of fits.
    """
    load = np.concatenate([np.zeros(6), guess.theta])
    body = settings.body(state.with_load(load))
    unknowns = body.unknowns
    total = wrench_evidence(body, MotionDerivatives.at(body), moments, load) + settings.expected(body)
    which = np.arange(unknowns.size)[unknowns.load if settings.has_offset else unknowns.theta]
    part = total.restricted(which)
    inverse = part.solve(settings.limits(unknowns.count, guess)[which]).inverse
    load[-len(which) :] += inverse @ part.score
    return state.with_load(load)

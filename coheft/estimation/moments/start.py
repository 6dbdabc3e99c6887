"""A first state in closed form, from moments alone.

R_ij = argmax tr(R_ij^T K),    K = sum w_i w_j^T / sigma_w^2 + ... + mean a_i (mean a_j)^T         (Davenport 1968)
p_ij from  v_j = R_ij^T (v_i + w_i x p_ij)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from coheft.estimation.geometry.spatial import Array, Pose, rotation_from_quaternion
from coheft.estimation.moments import rows
from coheft.estimation.moments.body import BodyModel
from coheft.estimation.moments.derivatives import MotionDerivatives
from coheft.estimation.moments.evidence import Evidence
from coheft.estimation.moments.fit import EvaluateMoments, fit_state
from coheft.estimation.moments.fit_settings import POSE_LIMITS, FitSettings, Guess
from coheft.estimation.moments.likelihood import wrench_evidence
from coheft.estimation.moments.moments import RowMoments, WrenchMoments
from coheft.estimation.moments.rows import ROW_SIZE, RowNoise
from coheft.estimation.moments.unknowns import Flags, Indices, State

_WEAK = 1e-9
"""Regularization, as a share of the noise: keeps the velocity solvable if nothing rotates."""
_FAINT = 1e-12


def first_poses(moments: RowMoments, known: State, noise: RowNoise, anchor: int, is_unknown: Flags) -> State:
    """Compute unknown poses, each from the motion sensors of that robot and of the anchor.

    Args:
        moments: Moments of rows.
        known: A state with the poses of all other robots.
        noise: Noise of rows.
        anchor: Index of a robot whose pose is known.
        is_unknown: Whether each robot's pose is unknown, shape (N,).
    """
    count = len(known.poses)
    one = ROW_SIZE * count
    number = moments.matrix[one, one]
    mean = moments.matrix[one] / number
    second = moments.matrix - number * np.outer(mean, mean)
    places = np.arange(one).reshape(count, ROW_SIZE)
    kinematics = np.broadcast_to(noise.kinematics, (count, rows.KINEMATICS_SIZE))
    accelerations = places[:, rows.A]
    swaying = second[accelerations, accelerations].sum() / count
    poses = list(known.poses)
    for robot in np.flatnonzero(is_unknown).tolist():
        gyro, velocity = 0.5 * (kinematics[anchor][[0, 3]] ** 2 + kinematics[robot][[0, 3]] ** 2)
        w_anchor, w_robot = places[anchor, rows.W], places[robot, rows.W]
        v_anchor, v_robot = places[anchor, rows.V], places[robot, rows.V]

        def cross(left: Indices, right: Indices) -> Array:
            result: Array = second[np.ix_(left, right)]
            return result

        turning = cross(w_anchor, w_anchor)
        by_turning = np.linalg.solve(turning + _WEAK * gyro * np.eye(3), cross(w_anchor, v_robot))
        likeness = 0.5 * cross(w_anchor, w_robot) / gyro
        likeness += 0.5 * (cross(v_anchor, v_robot) - cross(v_anchor, w_anchor) @ by_turning) / velocity
        # On average every accelerometer measures gravity alone.
        likeness += number**2 / (swaying + velocity) * np.outer(mean[accelerations[anchor]], mean[accelerations[robot]])
        rotation = _likeliest_rotation(likeness)
        # A weak pull to zero holds the position where the motion does not show it.
        pull = 2.0 * number * gyro + 2.0 * velocity / POSE_LIMITS[3] ** 2
        moment = cross(w_anchor, v_anchor) - cross(w_anchor, v_robot) @ rotation.T
        turned = (moment.T - moment)[[2, 0, 1], [1, 2, 0]]
        spread = (np.trace(turning) + pull) * np.eye(3) - turning
        poses[robot] = poses[anchor] @ Pose(rotation, np.linalg.solve(spread, turned))
    return replace(known, poses=tuple(poses))


def poses_by_motion(
    state: State,
    is_unknown: Flags,
    kept: RowMoments,
    evaluate: EvaluateMoments,
    before: Callable[[BodyModel], Evidence],
    settings: FitSettings,
    anchor: int,
) -> State:
    """Return the state without a load, its unknown poses computed in closed form, then fitted to the motion alone.

    Args:
        state: A state with the known poses.
        is_unknown: Whether each robot's pose is unknown, shape (N,).
        kept: Moments of rows for the closed form.
        evaluate: Moments that are fitted to, at a state.
        before: Prior evidence at a state.
        settings: Settings of the fit.
        anchor: Index of the robot whose pose stays fixed.
    """
    state = first_poses(kept, state, settings.noise, anchor, is_unknown).with_load(None)
    guess = Guess.of(settings.body(state), kept)
    return fit_state(state, evaluate, before, guess, settings, anchor).state


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

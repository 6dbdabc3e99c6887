"""The normal equations of hand-eye calibration (``hand_eye``), the load's pose of every sample eliminated.

That leaves the Schur complement of the loads' block, sample by sample, as in bundle adjustment (Brown 1958; Triggs,
McLauchlan, Hartley and Fitzgibbon 2000).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from coheft.estimation.batch.calibration import (
    ANGLE_SCALE,
    POSE_ERRORS,
    POSITION_SCALE,
    ZERO,
    gimbal_angles,
    gimbal_axes,
)
from coheft.estimation.batch.wrist_poses import WristPoses
from coheft.estimation.geometry.spatial import Array, Pose, skew

HOME, GRASP = slice(0, 6), slice(6, 12)
ERRORS = slice(12, 12 + POSE_ERRORS)
UNKNOWNS = 12 + POSE_ERRORS
"""Per robot: perturbations of home and grasp ``(rotation, translation)``, then the errors of its calibration."""
_CHUNK = 4000
"""Samples at a time: their derivatives take 3 kB each and robot."""


@dataclass(frozen=True, eq=False)
class Guess:
    """A point at which the fit is linearised.

    Attributes:
        homes: Home frames in the world.
        grasps: Grasp frames in the load.
        errors: Of each robot's calibration, shape (N, 7).
        rotations: The load's orientation in the world, shape (n, 3, 3).
        positions: Its position there, shape (n, 3).
    """

    homes: tuple[Pose, ...]
    grasps: tuple[Pose, ...]
    errors: Array
    rotations: Array
    positions: Array


def unknowns_of(count: int, part: slice) -> npt.NDArray[np.intp]:
    """Indices of some of every robot's unknowns."""
    own = np.arange(UNKNOWNS)[part]
    return np.concatenate([k * UNKNOWNS + own for k in range(count)])


def position_scale_rows(count: int) -> Array:
    """Picks each robot's position scale from the unknowns of N, shape (N, 19 N)."""
    picked: Array = np.eye(count * UNKNOWNS)[unknowns_of(count, ERRORS).reshape(count, -1)[:, POSITION_SCALE].ravel()]
    return picked


def residuals_and_derivatives(
    wrists: WristPoses, robot: int, home: Pose, grasp: Pose, errors: Array, rotations: Array, positions: Array
) -> tuple[Array, Array, Array]:
    """What one robot measured beyond what the load's poses predict, at n samples, and how that changes.

    Args:
        wrists: What was measured, N robots.
        robot: Which of them.
        home: ``H_i``.
        grasp: ``X_i``.
        errors: Of its calibration, shape (7,).
        rotations: The load's orientations, shape (n, 3, 3).
        positions: Its positions, shape (n, 3).

    Returns:
        Residuals (gimbal's angles, position) as the robot would measure them, shape (n, 6); their derivatives by the
        unknowns, shape (n, 6, 19), and by the load's perturbation ``(rotation, translation)`` in the world, shape
        (n, 6, 6).
    """
    to_home = home.rotation.T
    arm = rotations @ grasp.translation
    reach = arm + positions - home.translation
    place = reach @ home.rotation
    to_zero = wrists.zeros[robot].swapaxes(-1, -2) @ to_home
    angles = gimbal_angles(to_zero @ rotations @ grasp.rotation)
    angle_scale, scale = 1.0 + errors[ANGLE_SCALE], 1.0 + float(errors[POSITION_SCALE][0])
    residual = np.empty((len(angles), 6))
    residual[:, :3] = _between_half_turns(wrists.angles[robot] - angle_scale * angles - errors[ZERO])
    residual[:, 3:] = wrists.positions[robot] - scale * place
    turned = -angle_scale[:, None] * np.linalg.inv(gimbal_axes(angles)) @ to_zero
    moved = -scale * to_home
    by_load = np.zeros((len(angles), 6, 6))
    by_load[:, :3, :3] = turned
    by_load[:, 3:, :3], by_load[:, 3:, 3:] = -moved @ skew(arm), moved
    derivative = np.zeros((len(angles), 6, UNKNOWNS))
    derivative[:, :3, 0:3] = -turned
    derivative[:, 3:, 0:3], derivative[:, 3:, 3:6] = moved @ skew(reach), -moved
    derivative[:, :3, 6:9] = turned @ rotations
    derivative[:, 3:, 9:12] = moved @ rotations
    derivative[:, :3, 12:15] = -np.eye(3)
    derivative[:, :3, 15:18] = -angles[:, :, None] * np.eye(3)
    derivative[:, 3:, 18] = -place
    return residual, derivative, by_load


def _between_half_turns(angles: Array) -> Array:
    result: Array = (angles + np.pi) % (2.0 * np.pi) - np.pi
    return result


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Of all robots' unknowns, the load's poses eliminated.

    Attributes:
        matrix: Shape (19 N, 19 N).
        scores: Of each sample, shape (n, 19 N).
        squares: Sums of squared residuals of angles [rad²] and positions [m²], shape (2,).
        freedom: How many of these residuals are free, as the load's poses take up some, shape (2,).
        load_score: The load's own step if no unknown moved, shape (n, 6).
        load_gain: Minus what the unknowns' steps add to it, shape (n, 6, 19 N).
    """

    matrix: Array
    scores: Array
    squares: Array
    freedom: Array
    load_score: Array
    load_gain: Array

    @property
    def noise(self) -> tuple[float, float]:
        """Standard deviations of angles [rad] and positions [m], as the residuals show them."""
        angle, position = np.sqrt(self.squares / self.freedom)
        return float(angle), float(position)


def normal_equations(wrists: WristPoses, guess: Guess, noise: tuple[float, float]) -> NormalEquations:
    """Of all samples, weighted by the noise of angles [rad] and positions [m]."""
    parts = []
    for first in range(0, len(guess.rotations), _CHUNK):
        parts.append(_chunk(wrists, guess, noise, slice(first, first + _CHUNK)))
    return NormalEquations(
        matrix=np.sum([part.matrix for part in parts], axis=0),
        scores=np.concatenate([part.scores for part in parts]),
        squares=np.sum([part.squares for part in parts], axis=0),
        freedom=np.sum([part.freedom for part in parts], axis=0),
        load_score=np.concatenate([part.load_score for part in parts]),
        load_gain=np.concatenate([part.load_gain for part in parts]),
    )


def _chunk(wrists: WristPoses, guess: Guess, noise: tuple[float, float], rows: slice) -> NormalEquations:
    """Of some samples."""
    count = len(guess.grasps)
    some = wrists.some(rows)
    samples = some.angles.shape[1]
    weight = np.repeat([noise[0] ** -2, noise[1] ** -2], 3)
    size = count * UNKNOWNS
    matrix, scores = np.zeros((size, size)), np.zeros((samples, size))
    load, load_score, coupling = np.zeros((samples, 6, 6)), np.zeros((samples, 6)), np.zeros((samples, 6, size))
    kept = []
    for k in range(count):
        own = slice(k * UNKNOWNS, (k + 1) * UNKNOWNS)
        residual, derivative, by_load = residuals_and_derivatives(
            some, k, guess.homes[k], guess.grasps[k], guess.errors[k], guess.rotations[rows], guess.positions[rows]
        )
        weighted = (weight[:, None] * by_load).swapaxes(-1, -2)
        flat = derivative.reshape(-1, UNKNOWNS)
        matrix[own, own] = flat.T @ (np.tile(weight, samples)[:, None] * flat)
        scores[:, own] = -((weight * residual)[:, None] @ derivative)[:, 0]
        load += weighted @ by_load
        load_score -= (weighted @ residual[..., None])[..., 0]
        coupling[:, :, own] = weighted @ derivative
        kept.append((residual, by_load))
    covariance = np.linalg.inv(load)
    load_step = (covariance @ load_score[..., None])[..., 0]
    gain = covariance @ coupling
    matrix -= coupling.reshape(-1, size).T @ gain.reshape(-1, size)
    scores -= (load_step[:, None] @ coupling)[:, 0]
    # Each load's pose takes up six of the residuals; which share of them are angles follows from its covariance.
    squares, freedom = np.zeros(2), np.zeros(2)
    for residual, by_load in kept:
        left = residual + (by_load @ load_step[..., None])[..., 0]
        taken = np.einsum("nra,nab,nrb->r", by_load, covariance, by_load, optimize=True) * weight
        squares += [np.sum(left[:, :3] ** 2), np.sum(left[:, 3:] ** 2)]
        freedom += [3 * samples - taken[:3].sum(), 3 * samples - taken[3:].sum()]
    return NormalEquations(matrix, scores, squares, freedom, load_step, gain)

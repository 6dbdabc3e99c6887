"""Normal equations of hand-eye calibration (``hand_eye``), with the load's pose of each sample eliminated.

What remains is the Schur complement of the loads' block, sample by sample, as in bundle adjustment (Brown 1958; Triggs,
McLauchlan, Hartley and Fitzgibbon 2000).
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from coheft.estimation.batch.wrist_poses import (
    ANGLE_SCALE,
    POSE_ERRORS,
    POSITION_SCALE,
    ZERO,
    WristPoses,
    gimbal_angles,
    gimbal_axes,
    whole_turns,
)
from coheft.estimation.geometry.spatial import Array, Pose, skew
from coheft.estimation.linear_algebra import inverse

HOME, GRASP = slice(0, 6), slice(6, 12)
ERRORS = slice(12, 12 + POSE_ERRORS)
UNKNOWNS = 12 + POSE_ERRORS
"""Per robot: perturbations ``(rotation, translation)`` of home and grasp, then the calibration errors."""
_CHUNK = 4000
"""Samples that are processed at a time: derivatives take 3 kB per sample and robot."""


@dataclass(frozen=True, eq=False)
class Guess:
    """A point at which the fit is linearised.

    Attributes:
        homes: Home frames in the world.
        grasps: Grasp frames in the load.
        errors: Calibration errors of each robot, shape (N, 7).
        rotations: Orientations of the load in the world, shape (n, 3, 3).
        positions: Positions of the load in the world, shape (n, 3).
    """

    homes: tuple[Pose, ...]
    grasps: tuple[Pose, ...]
    errors: Array
    rotations: Array
    positions: Array


def unknowns_of(count: int, part: slice) -> npt.NDArray[np.intp]:
    """Indices of these unknowns of all robots."""
    own = np.arange(UNKNOWNS)[part]
    return np.concatenate([k * UNKNOWNS + own for k in range(count)])


def position_scale_rows(count: int) -> Array:
    """Selects each robot's position scale from the unknowns of N robots, shape (N, 19 N)."""
    return np.eye(count * UNKNOWNS)[unknowns_of(count, ERRORS).reshape(count, -1)[:, POSITION_SCALE].ravel()]


def residuals_and_derivatives(wrists: WristPoses, guess: Guess, robot: int) -> tuple[Array, Array, Array]:
    """Residuals of one robot's measurements at n samples, and their derivatives.

    Returns:
        Residuals (gimbal's angles, position), shape (n, 6); their derivatives by the unknowns, shape (n, 6, 19), and by
        the load's perturbation ``(rotation, translation)`` in the world, shape (n, 6, 6).
    """
    home, grasp, errors, rotations = guess.homes[robot], guess.grasps[robot], guess.errors[robot], guess.rotations
    to_home = home.rotation.T
    arm = rotations @ grasp.translation
    reach = arm + guess.positions - home.translation
    place = reach @ home.rotation
    to_zero = wrists.zeros[robot].swapaxes(-1, -2) @ to_home
    angles = gimbal_angles(to_zero @ rotations @ grasp.rotation)
    angles += whole_turns(wrists.angles[robot] - angles)
    angle_scale, scale = 1.0 + errors[ANGLE_SCALE], 1.0 + float(errors[POSITION_SCALE][0])
    residual = np.empty((len(angles), 6))
    residual[:, :3] = wrists.angles[robot] - angle_scale * angles - errors[ZERO]
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


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations of all robots' unknowns.

    Attributes:
        matrix: Information matrix, shape (19 N, 19 N).
        scores: Score of each sample, shape (n, 19 N).
        squares: Sums of squared residuals of angles [rad²] and positions [m²], shape (2,).
        freedom: Degrees of freedom of these residuals, without those of the load's poses, shape (2,).
        load_score: Step of the load's poses if no unknown moves, shape (n, 6).
        load_gain: Change of this step by minus the unknowns' steps, shape (n, 6, 19 N).
    """

    matrix: Array
    scores: Array
    squares: Array
    freedom: Array
    load_score: Array
    load_gain: Array

    @property
    def noise(self) -> tuple[float, float]:
        """Standard deviations of angles [rad] and positions [m] according to the residuals."""
        angle, position = np.sqrt(self.squares / self.freedom)
        return float(angle), float(position)


def normal_equations(wrists: WristPoses, guess: Guess, noise: tuple[float, float]) -> NormalEquations:
    """Normal equations of all samples, weighted by the noise of angles [rad] and positions [m]."""
    count, samples = wrists.angles.shape[:2]
    weight = np.repeat([noise[0] ** -2, noise[1] ** -2], 3)
    size = count * UNKNOWNS
    matrix, scores = np.zeros((size, size)), np.zeros((samples, size))
    load_steps, gains = np.zeros((samples, 6)), np.zeros((samples, 6, size))
    squares, freedom = np.zeros(2), np.zeros(2)
    for first in range(0, samples, _CHUNK):
        rows = slice(first, first + _CHUNK)
        some = replace(guess, rotations=guess.rotations[rows], positions=guess.positions[rows])
        measured, few = wrists.some(rows), len(some.positions)
        load, load_score, coupling = np.zeros((few, 6, 6)), np.zeros((few, 6)), np.zeros((few, 6, size))
        kept = []
        for k in range(count):
            own = slice(k * UNKNOWNS, (k + 1) * UNKNOWNS)
            residual, derivative, by_load = residuals_and_derivatives(measured, some, k)
            weighted = (weight[:, None] * by_load).swapaxes(-1, -2)
            flat = derivative.reshape(-1, UNKNOWNS)
            matrix[own, own] += flat.T @ (np.tile(weight, few)[:, None] * flat)
            scores[rows, own] = -((weight * residual)[:, None] @ derivative)[:, 0]
            load += weighted @ by_load
            load_score -= (weighted @ residual[..., None])[..., 0]
            coupling[:, :, own] = weighted @ derivative
            kept.append((residual, by_load))
        covariance = inverse(load)
        load_step = load_steps[rows] = (covariance @ load_score[..., None])[..., 0]
        gain = gains[rows] = covariance @ coupling
        matrix -= coupling.reshape(-1, size).T @ gain.reshape(-1, size)
        scores[rows] -= (load_step[:, None] @ coupling)[:, 0]
        # Each pose of the load takes six degrees of freedom from the residuals, divided according to its covariance.
        for residual, by_load in kept:
            left = residual + (by_load @ load_step[..., None])[..., 0]
            taken = np.einsum("nra,nab,nrb->r", by_load, covariance, by_load, optimize=True) * weight
            squares += [np.sum(left[:, :3] ** 2), np.sum(left[:, 3:] ** 2)]
            freedom += [3 * few - taken[:3].sum(), 3 * few - taken[3:].sum()]
    return NormalEquations(matrix, scores, squares, freedom, load_steps, gains)

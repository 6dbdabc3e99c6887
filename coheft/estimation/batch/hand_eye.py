"""Where robots hold a load, from their poses alone: nothing is differentiated.

Robot i knows the pose ``T_i`` of its grasp frame in its home frame. With the load's pose ``B`` in the world,

    T_i = H_i^-1 B X_i,

``H_i`` the home frame in the world and ``X_i`` the grasp frame in the load (robot-world and hand-eye calibration,
``A X = X B`` between two samples). World and load are the home and the grasp frame of the first robot. All samples of
all robots are fitted at once by maximum likelihood, the load's pose of every sample eliminated: that closes all loops.
What may be wrong with the robots' calibration is fitted along, held by how wrong it may be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from coheft.errors import RecordingError
from coheft.estimation.batch.calibration import (
    ANGLE_SCALE,
    POSE_ERRORS,
    POSITION_SCALE,
    ZERO,
    Tolerances,
    gimbal_angles,
    gimbal_axes,
    gimbal_rotations,
)
from coheft.estimation.batch.statistics import batch_scatter
from coheft.estimation.body_motion import perturbed
from coheft.estimation.observability import Visibility
from coheft.estimation.spatial import Array, Pose, skew
from coheft.estimation.team_registration import TeamPoses

_STEPS = 15
_CLOSE = 1e-7
_DAMPING = 1e-2
"""Information on each step of a pose [1/rad², 1/m²]."""
_SETTLED = 0.01
"""Relative change of the noise that is seen, when it counts as known."""
_CHUNK = 4000
"""Samples at a time: their derivatives take 3 kB each and robot."""
_HOME, _GRASP = slice(0, 6), slice(6, 12)
_ERRORS = slice(12, 12 + POSE_ERRORS)
_LARGEST_TILT = 70.0
"""Of the gimbal's second angle [degrees]; at 90 the two others turn about the same axis."""
UNKNOWNS = 12 + POSE_ERRORS
"""Per robot: perturbations of home and grasp ``(rotation, translation)``, then the errors of its calibration."""
_ANGLE_NOISE, _POSITION_NOISE = 1e-3, 1e-3
"""First guesses [rad, m]; the residuals tell better ones."""


@dataclass(frozen=True, eq=False)
class WristPoses:
    """What encoders measured.

    Attributes:
        angles: Of the gimbals, shape (N, n, 3) [rad].
        positions: In the home frames, shape (N, n, 3) [m].
        zeros: Orientations in the home frames where the angles are zero, shape (N, 3, 3).
        rate: Samples per second.
    """

    angles: Array
    positions: Array
    zeros: Array
    rate: float

    @staticmethod
    def of(poses: Array, rate: float, *, at_home: bool) -> WristPoses:
        """From poses ``x y z qx qy qz qw`` in the home frames, shape (N, n, 7).

        Args:
            poses: As recorded.
            rate: Samples per second.
            at_home: Whether the angles shall be those of real gimbals, which are zero at home. Otherwise they count
                from the middle of the motion: no robot's angles are singular there.

        Raises:
            RecordingError: Real gimbals would be near their singularity.
        """
        rotations = Rotation.from_quat(poses[..., 3:].reshape(-1, 4)).as_matrix().reshape(*poses.shape[:2], 3, 3)
        zeros = np.tile(np.eye(3), (len(poses), 1, 1))
        if not at_home:
            zeros = np.array([Rotation.from_matrix(own).mean().as_matrix() for own in rotations])
        angles = gimbal_angles(zeros[:, None].swapaxes(-1, -2) @ rotations)
        largest = float(np.degrees(np.abs(angles[..., 1]).max()))
        if largest > _LARGEST_TILT:
            raise RecordingError(
                f"gimbals turn by {largest:.0f}° about their second axis, but only up to {_LARGEST_TILT:g}° can be "
                f"told from poses: give poses relative to a home in the middle of the motion"
            )
        return WristPoses(angles, poses[..., :3], zeros, rate)

    def some(self, rows: slice) -> WristPoses:
        """Only some samples."""
        return replace(self, angles=self.angles[:, rows], positions=self.positions[:, rows])

    def averaged(self, rate: float) -> WristPoses:
        """Means of neighbouring samples, about ``rate`` of them a second, slow as things move beside that."""
        length = max(1, int(self.rate / rate))
        count = self.angles.shape[1] // length

        def mean(samples: Array) -> Array:
            result: Array = samples[:, : count * length].reshape(len(samples), count, length, 3).mean(axis=2)
            return result

        return replace(self, angles=mean(self.angles), positions=mean(self.positions), rate=self.rate / length)

    def rotations(self, robot: int) -> Array:
        """Orientations of a grasp frame in its home frame as measured, shape (n, 3, 3)."""
        result: Array = self.zeros[robot] @ gimbal_rotations(self.angles[robot])
        return result


@dataclass(frozen=True, eq=False)
class HandEye:
    """The fit.

    Attributes:
        team: Grasp frames in the first one.
        homes: Home frames in the first one.
        errors: Of each robot's calibration, shape (N, 7).
        errors_std: Their standard deviations, shape (N, 7); where they are those of before, nothing was learned.
        body_rotations: The load's orientation in the world, shape (n, 3, 3).
        body_positions: Its position there, shape (n, 3).
        noise: Standard deviation of a sample's angles [rad] and positions [m].
        covariance: Of all unknowns of all robots, shape (19 N, 19 N).
    """

    team: TeamPoses
    homes: tuple[Pose, ...]
    errors: Array
    errors_std: Array
    body_rotations: Array
    body_positions: Array
    noise: tuple[float, float]
    covariance: Array


@dataclass(frozen=True, eq=False)
class _Guess:
    """A point at which the fit is linearised."""

    homes: tuple[Pose, ...]
    grasps: tuple[Pose, ...]
    errors: Array
    rotations: Array
    positions: Array


def fit_hand_eye(wrists: WristPoses, start: Sequence[Pose], tolerances: Tolerances | None = None) -> HandEye:
    """Fit all poses.

    Args:
        wrists: What was measured.
        start: Rough poses of the grasp frames in the first one.
        tolerances: How well the robots are calibrated; None: perfectly.
    """
    count = len(wrists.angles)
    prior, free = _prior(count, tolerances)
    guess = _start(wrists, start)
    noise = (_ANGLE_NOISE, _POSITION_NOISE)
    for _ in range(_STEPS):
        equations = _normal_equations(wrists, guess, noise)
        matrix = equations.matrix[np.ix_(free, free)] + np.diag(prior[free])
        step = np.zeros(count * UNKNOWNS)
        step[free] = np.linalg.solve(matrix, (equations.scores.sum(axis=0) - prior * _flat(guess))[free])
        guess = _moved(guess, step, equations.load_score - equations.load_gain @ step)
        settled = np.abs(np.log(np.divide(equations.noise, noise))).max() < _SETTLED
        noise = equations.noise
        if settled and np.abs(step).max() < _CLOSE:
            break
    inverse = np.linalg.inv(matrix)
    scatter = batch_scatter(equations.scores[:, free], wrists.rate) + np.diag(prior[free])
    covariance = np.zeros((count * UNKNOWNS, count * UNKNOWNS))
    covariance[np.ix_(free, free)] = inverse @ scatter @ inverse
    spread = np.sqrt(np.diag(covariance)).reshape(count, UNKNOWNS)
    grasps = np.concatenate([np.arange(k * UNKNOWNS, k * UNKNOWNS + 12)[_GRASP] for k in range(count)])
    return HandEye(
        team=TeamPoses(guess.grasps, covariance[np.ix_(grasps, grasps)], Visibility()),
        homes=guess.homes,
        errors=guess.errors,
        errors_std=spread[:, _ERRORS],
        body_rotations=guess.rotations,
        body_positions=guess.positions,
        noise=noise,
        covariance=covariance,
    )


def _prior(count: int, tolerances: Tolerances | None) -> tuple[Array, npt.NDArray[np.intp]]:
    """Information on all unknowns before the data, (19 N,), and indices of those that are fitted at all."""
    prior = np.full((count, UNKNOWNS), _DAMPING)
    free = np.ones((count, UNKNOWNS), dtype=np.bool_)
    free[0, :12] = False
    spread = np.zeros(POSE_ERRORS) if tolerances is None else tolerances.pose_errors()
    free[:, _ERRORS] = spread > 0.0
    # Poses are not held anywhere: this only keeps steps finite where nothing is seen.
    prior[:, _ERRORS] = np.where(spread > 0.0, 1.0 / np.maximum(spread, 1e-12) ** 2, 0.0)
    return prior.ravel(), np.flatnonzero(free)


def _start(wrists: WristPoses, grasps: Sequence[Pose]) -> _Guess:
    """The load's poses as the first robot tells them, and homes that fit on average."""
    errors = np.zeros((len(grasps), POSE_ERRORS))
    rotations, positions = wrists.rotations(0), wrists.positions[0]
    homes = [Pose.identity()]
    for robot, (told, grasp) in enumerate(zip(wrists.positions[1:], grasps[1:], strict=True), 1):
        own = wrists.rotations(robot)
        home = Rotation.from_matrix(rotations @ grasp.rotation @ own.swapaxes(-1, -2)).mean().as_matrix()
        homes.append(Pose(home, np.mean(rotations @ grasp.translation + positions - told @ home.T, axis=0)))
    return _Guess(tuple(homes), tuple(grasps), errors, rotations, positions)


def _flat(guess: _Guess) -> Array:
    """Where the guess is, of the unknowns that have a prior: the errors; zero elsewhere."""
    flat = np.zeros((len(guess.errors), UNKNOWNS))
    flat[:, _ERRORS] = guess.errors
    return flat.ravel()


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
    to_zero = wrists.zeros[robot].T @ to_home
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
class _NormalEquations:
    """Of all robots' unknowns, the load's poses eliminated.

    Attributes:
        matrix: Shape (19 N, 19 N).
        scores: Of each sample, shape (n, 19 N).
        noise: Of angles [rad] and positions [m], as the residuals show it.
        load_score: The load's own step if no unknown moved, shape (n, 6).
        load_gain: Minus what the unknowns' steps add to it, shape (n, 6, 19 N).
    """

    matrix: Array
    scores: Array
    noise: tuple[float, float]
    load_score: Array
    load_gain: Array


def _normal_equations(wrists: WristPoses, guess: _Guess, noise: tuple[float, float]) -> _NormalEquations:
    parts = []
    for first in range(0, len(guess.rotations), _CHUNK):
        parts.append(_chunk(wrists, guess, noise, slice(first, first + _CHUNK)))
    seen: Array = np.array([part.noise for part in parts]).mean(axis=0)
    return _NormalEquations(
        matrix=np.sum([part.matrix for part in parts], axis=0),
        scores=np.concatenate([part.scores for part in parts]),
        noise=(float(np.sqrt(seen[0])), float(np.sqrt(seen[1]))),
        load_score=np.concatenate([part.load_score for part in parts]),
        load_gain=np.concatenate([part.load_gain for part in parts]),
    )


def _chunk(wrists: WristPoses, guess: _Guess, noise: tuple[float, float], rows: slice) -> _NormalEquations:
    """Of some samples; ``noise`` of the result are variances."""
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
    variances = squares / freedom
    return _NormalEquations(matrix, scores, (float(variances[0]), float(variances[1])), load_step, gain)


def _moved(guess: _Guess, step: Array, load_step: Array) -> _Guess:
    """The guess after a step of all robots' unknowns (19 N,) and of the load's poses (n, 6)."""
    steps = step.reshape(-1, UNKNOWNS)
    turns = Rotation.from_rotvec(load_step[:, :3]).as_matrix()
    return _Guess(
        homes=tuple(perturbed(pose, own[_HOME]) for pose, own in zip(guess.homes, steps, strict=True)),
        grasps=tuple(perturbed(pose, own[_GRASP]) for pose, own in zip(guess.grasps, steps, strict=True)),
        errors=guess.errors + steps[:, _ERRORS],
        rotations=turns @ guess.rotations,
        positions=guess.positions + load_step[:, 3:],
    )

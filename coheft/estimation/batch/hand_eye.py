"""Where robots hold a load, from their poses alone: nothing is differentiated.

Robot i knows the pose ``T_i`` of its grasp frame in its home frame. With the load's pose ``B`` in the world,

    T_i = H_i^-1 B X_i,

``H_i`` the home frame in the world and ``X_i`` the grasp frame in the load (hand-eye calibration, ``A X = X B`` between
two samples: Shiu and Ahmad 1989; with the robots' places in the world: Zhuang, Roth and Sudhakar 1994). World and load
are the home and the grasp frame of the first robot. All samples of all robots are fitted at once by maximum likelihood,
the load's pose of every sample eliminated: that closes all loops. What may be wrong with the robots' calibration is
fitted along, held by how wrong it may be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from coheft.estimation.batch.calibration import POSE_ERRORS, Tolerances
from coheft.estimation.batch.hand_eye_equations import (
    ERRORS,
    GRASP,
    HOME,
    UNKNOWNS,
    Guess,
    normal_equations,
    unknowns_of,
)
from coheft.estimation.batch.statistics import EXACT, batch_scatter
from coheft.estimation.batch.team_poses import TeamPoses
from coheft.estimation.batch.wrist_poses import WristPoses
from coheft.estimation.geometry.body_motion import perturbed
from coheft.estimation.geometry.observability import Visibility
from coheft.estimation.geometry.spatial import Array, Pose

_STEPS, _STEPS_OF_FEW = 15, 100
"""The latter where samples are few: weights of angles and positions then settle slowly."""
_CLOSE = 1e-7
"""No more steps are taken after one that is smaller than this [rad, m]."""
_SMALL = 0.1
"""A last step below this share of the standard deviation makes no difference."""
_DAMPING = 1e-2
"""Information on each step of a pose [1/rad², 1/m²]."""
_SETTLED = 0.01
"""Relative change of the noise that is seen, when it counts as known."""
_ANGLE_NOISE, _POSITION_NOISE = 1e-3, 1e-3
"""First guesses [rad, m]; the residuals tell better ones."""
_FINEST = 1e-5
"""Poses that fit better than this [rad, m] are weighted as if they did not: no weight is infinite."""
_ROUNDING = 1e-12
"""Share of the largest information below which there is none, only rounding."""


@dataclass(frozen=True, eq=False)
class HandEye:
    """The fit.

    Attributes:
        team: Grasp frames in the first one.
        homes: Home frames in the first one.
        errors: Of each robot's calibration, shape (N, 7).
        errors_std: Their standard deviations, shape (N, 7); where they are those of before, nothing was learned.
        noise: Standard deviation of a sample's angles [rad] and positions [m], 1e-5 at least.
        covariance: Of all unknowns of all robots, shape (19 N, 19 N).
        is_settled: Whether steps were small beside standard deviations when no more were taken.
    """

    team: TeamPoses
    homes: tuple[Pose, ...]
    errors: Array
    errors_std: Array
    noise: tuple[float, float]
    covariance: Array
    is_settled: bool


def fit_hand_eye(
    wrists: WristPoses, start: Sequence[Pose], tolerances: Tolerances | None = None, *, is_independent: bool = False
) -> HandEye:
    """Fit all poses.

    Args:
        wrists: What was measured.
        start: Rough poses of the grasp frames in the first one.
        tolerances: How well the robots are calibrated; None: perfectly.
        is_independent: Samples are few, but have errors of their own each: more than twelve numbers of each robot but
            the first. Otherwise how certain all is follows from how errors change over time.
    """
    count = len(wrists.angles)
    prior, free = _prior(count, tolerances)
    guess = _start(wrists, start)
    noise = (_ANGLE_NOISE, _POSITION_NOISE)
    for _ in range(_STEPS_OF_FEW if is_independent else _STEPS):
        equations = normal_equations(wrists, guess, noise)
        shown = _Shown.of(equations.matrix[np.ix_(free, free)], prior[free])
        step = np.zeros(count * UNKNOWNS)
        step[free] = shown.step(equations.scores.sum(axis=0)[free], _flat(guess)[free])
        guess = _moved(guess, step, equations.load_score - equations.load_gain @ step)
        found = np.maximum(equations.noise, _FINEST)
        is_noise_known = np.abs(np.log(found / noise)).max() < _SETTLED
        noise = (float(found[0]), float(found[1]))
        if is_noise_known and np.abs(step).max() < _CLOSE:
            break
    covariance = np.zeros((count * UNKNOWNS, count * UNKNOWNS))
    if is_independent:  # the unknowns and the load's poses take up some of the residuals
        residuals = (count - 1) * 6 * wrists.angles.shape[1]
        scatter = equations.matrix[np.ix_(free, free)] * residuals / (residuals - len(free))
    else:
        scatter = batch_scatter(equations.scores[:, free], wrists.rate)
    covariance[np.ix_(free, free)] = shown.covariance(scatter)
    poses = np.intersect1d(free, unknowns_of(count, slice(0, GRASP.stop)))
    covariance[poses, poses] += EXACT**2
    spread = np.sqrt(np.diag(covariance)).reshape(count, UNKNOWNS)
    grasps = unknowns_of(count, GRASP)
    is_small = np.abs(step) <= np.maximum(_CLOSE, _SMALL * spread.ravel())
    return HandEye(
        team=TeamPoses(guess.grasps, covariance[np.ix_(grasps, grasps)], Visibility()),
        homes=guess.homes,
        errors=guess.errors,
        errors_std=spread[:, ERRORS],
        noise=noise,
        covariance=covariance,
        is_settled=bool(is_noise_known and is_small.all()),
    )


@dataclass(frozen=True, eq=False)
class _Shown:
    """Information of the data, in directions in units of the prior's standard deviations.

    Attributes:
        values: Of the data's information, shape (u,); zero where it is rounding.
        directions: As columns, in the unknowns' units, shape (u, u).
        weights: Rows that take scores to these directions, zero where the data have no information, shape (u, u).
    """

    values: Array
    directions: Array
    weights: Array

    @staticmethod
    def of(information: Array, prior: Array) -> _Shown:
        """From the data's information (u, u) and the prior's, (u,), which is positive."""
        units = 1.0 / np.sqrt(prior)
        values, vectors = np.linalg.eigh(information * np.outer(units, units))
        values = np.where(values > _ROUNDING * values[-1], values, 0.0)
        directions = units[:, None] * vectors
        return _Shown(values, directions, np.where(values > 0.0, directions, 0.0).T)

    def step(self, score: Array, place: Array) -> Array:
        """Newton step (u,) with the data's score (u,), from this place as seen from the prior's mean, (u,)."""
        behind = np.linalg.solve(self.directions, place)
        result: Array = self.directions @ ((self.weights @ score - behind) / (1.0 + self.values))
        return result

    def covariance(self, scatter: Array) -> Array:
        """Covariance (u, u) of the solution if the data's scores have this one, (u, u)."""
        spread = self.directions / (1.0 + self.values)
        result: Array = spread @ (self.weights @ scatter @ self.weights.T + np.eye(len(scatter))) @ spread.T
        return result


def _prior(count: int, tolerances: Tolerances | None) -> tuple[Array, npt.NDArray[np.intp]]:
    """Information on all unknowns before the data, (19 N,), and indices of those that are fitted at all."""
    prior = np.full((count, UNKNOWNS), _DAMPING)
    free = np.ones((count, UNKNOWNS), dtype=np.bool_)
    free[0, :12] = False
    spread = np.zeros(POSE_ERRORS) if tolerances is None else tolerances.pose_errors()
    free[:, ERRORS] = spread > 0.0
    # Poses are not held anywhere: this only keeps steps finite where nothing is seen.
    prior[:, ERRORS] = np.where(spread > 0.0, 1.0 / np.maximum(spread, 1e-12) ** 2, 0.0)
    return prior.ravel(), np.flatnonzero(free)


def _start(wrists: WristPoses, grasps: Sequence[Pose]) -> Guess:
    """The load's poses as the first robot tells them, and homes that fit on average."""
    errors = np.zeros((len(grasps), POSE_ERRORS))
    rotations, positions = wrists.rotations(0), wrists.positions[0]
    homes = [Pose.identity()]
    for robot, (told, grasp) in enumerate(zip(wrists.positions[1:], grasps[1:], strict=True), 1):
        own = wrists.rotations(robot)
        home = Rotation.from_matrix(rotations @ grasp.rotation @ own.swapaxes(-1, -2)).mean().as_matrix()
        homes.append(Pose(home, np.mean(rotations @ grasp.translation + positions - told @ home.T, axis=0)))
    return Guess(tuple(homes), tuple(grasps), errors, rotations, positions)


def _flat(guess: Guess) -> Array:
    """Where the guess is, of the unknowns that have a prior: the errors; zero elsewhere."""
    flat = np.zeros((len(guess.errors), UNKNOWNS))
    flat[:, ERRORS] = guess.errors
    return flat.ravel()


def _moved(guess: Guess, step: Array, load_step: Array) -> Guess:
    """The guess after a step of all robots' unknowns (19 N,) and of the load's poses (n, 6)."""
    steps = step.reshape(-1, UNKNOWNS)
    turns = Rotation.from_rotvec(load_step[:, :3]).as_matrix()
    return Guess(
        homes=tuple(perturbed(pose, own[HOME]) for pose, own in zip(guess.homes, steps, strict=True)),
        grasps=tuple(perturbed(pose, own[GRASP]) for pose, own in zip(guess.grasps, steps, strict=True)),
        errors=guess.errors + steps[:, ERRORS],
        rotations=turns @ guess.rotations,
        positions=guess.positions + load_step[:, 3:],
    )

"""Grasp poses from the robots' poses, without derivatives.

Robot i measures the pose ``T_i`` of its grasp frame in its home frame. With the load's pose ``B`` in the world,

    T_i = H_i^-1 B X_i,

``H_i`` the home frame in the world and ``X_i`` the grasp frame in the load (hand-eye calibration, ``A X = X B`` between
two samples: Shiu and Ahmad 1989; with the robots' places in the world: Zhuang, Roth and Sudhakar 1994). World and load
are the home and the grasp frame of the first robot. All samples of all robots are fitted at once by maximum likelihood,
with the load's poses eliminated, which closes all loops. Calibration errors are fitted along, with their tolerances as
prior.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from coheft.estimation.batch.hand_eye_equations import (
    ERRORS,
    GRASP,
    HOME,
    UNKNOWNS,
    Guess,
    normal_equations,
    unknowns_of,
)
from coheft.estimation.batch.pairs import TeamPoses
from coheft.estimation.batch.statistics import EXACT, scatter_of_sum
from coheft.estimation.batch.wrist_poses import ANGLE_ERRORS, POSE_ERRORS, Tolerances, WristPoses
from coheft.estimation.geometry.body_motion import perturbed
from coheft.estimation.geometry.observability import LIMITS
from coheft.estimation.geometry.spatial import Array, Pose

_STEPS, _STEPS_OF_FEW = 15, 100
"""The latter for few samples: weights of angles and positions then converge slowly."""
_CLOSE = 1e-7
"""The iteration ends with a step that is smaller than this [rad, m]."""
_SMALL = 0.1
"""Share of the standard deviation below which the last step does not matter."""
_DAMPING = 1e-2
"""Information that is added to each pose [1/rad², 1/m²]: steps stay finite where nothing is observable."""
_SETTLED = 0.01
"""Relative change of the estimated noise below which it counts as known."""
_NOISE = (1e-3, 1e-3)
"""First guess of the noise of angles and positions [rad, m]; residuals then determine it."""
_FINEST = 1e-5
"""Least noise [rad, m], so that weights are finite."""
_ROUNDING = 1e-12
"""Share of the largest information below which it is rounding."""
_OF_DIFFERENCES = 6.0
"""Variance of second differences of white noise of variance one."""
_BY_NOISE = 0.1
"""Share of the information that noise alone may have."""
_HIDDEN = 100.0
"""Stands for infinite deviations of what is not observable, in multiples of ``LIMITS``."""


@dataclass(frozen=True, eq=False)
class HandEye:
    """The fit.

    Attributes:
        team: Poses of the grasp frames in the first one.
        homes: Poses of the home frames in the first one.
        errors: Calibration errors of each robot, shape (N, 7).
        errors_std: Their standard deviations, shape (N, 7); equal to the prior's where nothing was learned.
        noise: Standard deviations of a sample's angles [rad] and positions [m], at least 1e-5.
        covariance: Covariance of all unknowns of all robots, shape (19 N, 19 N).
    """

    team: TeamPoses
    homes: tuple[Pose, ...]
    errors: Array
    errors_std: Array
    noise: tuple[float, float]
    covariance: Array


def fit_hand_eye(
    wrists: WristPoses, start: Sequence[Pose], tolerances: Tolerances | None = None, *, is_independent: bool = False
) -> HandEye:
    """Fit all poses, and the calibration errors that have tolerances.

    Args:
        wrists: The measured angles and positions.
        start: Rough poses of the grasp frames in the first one.
        tolerances: Tolerances of the calibration errors; None if robots are perfectly calibrated.
        is_independent: Whether samples are few with independent errors, but more than twelve numbers per robot without
            the first. Otherwise the covariance follows from the correlation of residuals over time.
    """
    count = len(wrists.angles)
    prior, free = _prior(wrists.has_gimbal, tolerances)
    guess = _start(wrists, start)
    noise = _NOISE
    for _ in range(_STEPS_OF_FEW if is_independent else _STEPS):
        equations = normal_equations(wrists, guess, noise)
        shown = _Shown(equations.matrix[np.ix_(free, free)], prior[free])
        step, place = np.zeros(count * UNKNOWNS), np.hstack([np.zeros((count, ERRORS.start)), guess.errors]).ravel()
        step[free] = shown.step(equations.scores.sum(axis=0)[free], place[free])
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
        scatter = scatter_of_sum(equations.scores[:, free], wrists.rate, 6 * (count - 1))
    covariance[np.ix_(free, free)] = shown.covariance(scatter)
    poses = np.intersect1d(free, unknowns_of(count, slice(0, GRASP.stop)))
    covariance[poses, poses] += EXACT**2
    turned = noise[0] if is_independent else min(noise[0], _noise_of_turns(wrists))
    for own, unseen in _shown_by_noise(equations.matrix, poses, wrists.angles.shape[:2], noise, turned):
        covariance[np.ix_(own, own)] += unseen
    spread = np.sqrt(np.diag(covariance)).reshape(count, UNKNOWNS)
    grasps = unknowns_of(count, GRASP)
    is_small = np.abs(step) <= np.maximum(_CLOSE, _SMALL * spread.ravel())
    return HandEye(
        team=TeamPoses(guess.grasps, covariance[np.ix_(grasps, grasps)], bool(is_noise_known and is_small.all())),
        homes=guess.homes,
        errors=guess.errors,
        errors_std=spread[:, ERRORS],
        noise=noise,
        covariance=covariance,
    )


class _Shown:
    """Eigenvectors of the data's information (u, u), in units of the deviations of the prior, with information (u,).

    Scores are not used where the data have no information.
    """

    def __init__(self, information: Array, prior: Array) -> None:
        units = 1.0 / np.sqrt(prior)
        values, vectors = np.linalg.eigh(information * np.outer(units, units))
        self._values: Array = np.where(values > _ROUNDING * values[-1], values, 0.0)
        self._directions: Array = units[:, None] * vectors
        self._weights: Array = np.where(self._values > 0.0, self._directions, 0.0).T

    def step(self, score: Array, place: Array) -> Array:
        """Newton step (u,) for the data's score (u,), at this distance (u,) from the prior's mean."""
        behind = np.linalg.solve(self._directions, place)
        return self._directions @ ((self._weights @ score - behind) / (1.0 + self._values))

    def covariance(self, scatter: Array) -> Array:
        """Covariance (u, u) of the solution for this covariance (u, u) of the data's scores."""
        spread = self._directions / (1.0 + self._values)
        return spread @ (self._weights @ scatter @ self._weights.T + np.eye(len(scatter))) @ spread.T


def _shown_by_noise(
    information: Array,
    poses: npt.NDArray[np.intp],
    counts: tuple[int, ...],
    noise: tuple[float, float],
    turned: float,
) -> Iterator[tuple[npt.NDArray[np.intp], Array]]:
    """Yield each grasp's unknowns, and a huge covariance (6, 6) of directions that nothing shows but noise.

    Where the load does not turn, noise of its orientation seems to be motion, and so to carry ``information`` (u, u) on
    homes and grasps, whose indices are ``poses``. The more samples there are, the more it would be. ``counts`` are the
    numbers of robots and of samples; these were weighted by ``noise``, the deviations of their angles [rad] and
    positions [m]. That of one robot's orientations is ``turned`` [rad].
    """
    covariance = np.zeros_like(information)
    damping = _DAMPING * np.eye(len(poses))
    covariance[np.ix_(poses, poses)] = np.linalg.inv(information[np.ix_(poses, poses)] + damping)
    count, samples = counts
    # All robots measure the load's orientation.
    units = np.sqrt(samples / count) * np.repeat([turned / noise[0], turned / noise[1]], 3)
    for own in unknowns_of(count, GRASP).reshape(count, -1)[1:]:
        shares, directions = np.linalg.eigh(units[:, None] * covariance[np.ix_(own, own)] * units)
        unseen = directions[:, shares > _BY_NOISE] / units[:, None]
        unseen *= _HIDDEN / np.linalg.norm(unseen / LIMITS[:, None], axis=0)
        yield own, unseen @ unseen.T


def _noise_of_turns(wrists: WristPoses) -> float:
    """Standard deviation of the noise of one robot's orientations, by second differences [rad].

    Faults of a recording, such as clocks that differ, do not enlarge it.
    """
    squares = []
    for robot in range(len(wrists.angles)):
        rotations = Rotation.from_matrix(wrists.rotations(robot))
        steps = (rotations[:-1].inv() * rotations[1:]).as_rotvec()
        squares.append(np.mean(np.diff(steps, axis=0) ** 2))
    return float(np.sqrt(np.mean(squares) / _OF_DIFFERENCES))


def _prior(has_gimbal: npt.NDArray[np.bool_], tolerances: Tolerances | None) -> tuple[Array, npt.NDArray[np.intp]]:
    """Prior information on all unknowns, shape (19 N,), and indices of the unknowns to fit."""
    count = len(has_gimbal)
    prior = np.full((count, UNKNOWNS), _DAMPING)
    free = np.ones((count, UNKNOWNS), dtype=np.bool_)
    free[0, :12] = False
    spread = np.tile(np.zeros(POSE_ERRORS) if tolerances is None else tolerances.pose_errors(), (count, 1))
    spread[~has_gimbal, ANGLE_ERRORS] = 0.0
    free[:, ERRORS] = spread > 0.0
    prior[:, ERRORS] = np.where(spread > 0.0, 1.0 / np.maximum(spread, 1e-12) ** 2, 0.0)
    return prior.ravel(), np.flatnonzero(free)


def _start(wrists: WristPoses, grasps: Sequence[Pose]) -> Guess:
    """Start with the load's poses according to the first robot, and mean home frames."""
    errors = np.zeros((len(grasps), POSE_ERRORS))
    rotations, positions = wrists.rotations(0), wrists.positions[0]
    homes = [Pose.identity()]
    for robot, (measured, grasp) in enumerate(zip(wrists.positions[1:], grasps[1:], strict=True), 1):
        own = wrists.rotations(robot)
        home = Rotation.from_matrix(rotations @ grasp.rotation @ own.swapaxes(-1, -2)).mean().as_matrix()
        homes.append(Pose(home, np.mean(rotations @ grasp.translation + positions - measured @ home.T, axis=0)))
    return Guess(tuple(homes), tuple(grasps), errors, rotations, positions)


def _moved(guess: Guess, step: Array, load_step: Array) -> Guess:
    """The guess after steps of all robots' unknowns (19 N,) and of the load's poses (n, 6)."""
    steps = step.reshape(-1, UNKNOWNS)
    turns = Rotation.from_rotvec(load_step[:, :3]).as_matrix()
    return Guess(
        homes=tuple(perturbed(pose, own[HOME]) for pose, own in zip(guess.homes, steps, strict=True)),
        grasps=tuple(perturbed(pose, own[GRASP]) for pose, own in zip(guess.grasps, steps, strict=True)),
        errors=guess.errors + steps[:, ERRORS],
        rotations=turns @ guess.rotations,
        positions=guess.positions + load_step[:, 3:],
    )

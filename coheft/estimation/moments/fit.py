"""The likeliest state: damped Gauss-Newton steps on poses, sensors' errors, wrench offset and load together.

step = (sum of informations)^-1 (sum of scores),    sum over motion, wrench, chapters before, expected errors
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.body import BodyModel
from coheft.estimation.moments.derivatives import MotionDerivatives
from coheft.estimation.moments.evidence import Evidence
from coheft.estimation.moments.fit_settings import POSE_LIMITS, FitSettings, Guess
from coheft.estimation.moments.likelihood import motion_evidence, wrench_evidence
from coheft.estimation.moments.moments import EvaluatedMoments
from coheft.estimation.moments.unknowns import Flags, State

_FARTHEST = 6.0
"""No error of a sensor becomes larger, in prior deviations: a gain of zero would explain everything."""
_LONGEST = 0.3
"""A step is shortened until it moves no pose by more [rad, m]."""
_FAR = 3.0
"""After a step of so many standard deviations the noise of regressors is worked out anew."""
MOST_STEPS, SMALL_ERROR = 10, 0.01
"""Steps of a fit at most; one that leaves less, in standard deviations of what it moves, is the last one."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """A state and how well it is known.

    Attributes:
        body: The matrices at the state.
        seen: Covariance (u, u) of all unknowns in the directions that are seen.
        hidden: In those that are not.
        step: How far the last step moved a pose, in its standard deviations.
        size: Rough size of the load [m].
    """

    body: BodyModel
    seen: Array
    hidden: Array
    step: float
    size: float

    @property
    def state(self) -> State:
        """Of the body."""
        return self.body.state

    @property
    def covariance(self) -> Array:
        """Of all unknowns, shape (u, u)."""
        return self.seen + self.hidden

    @cached_property
    def misses_poses(self) -> bool:
        """Whether any robot's pose is hidden."""
        return bool(self.hidden_poses().any())

    def hidden_poses(self, limits: Array = POSE_LIMITS) -> Flags:
        """Whether any part of a robot's pose is hidden or known less well than ``limits`` (6,), shape (N,)."""
        variances = (self.seen + self.hidden).diagonal()[self.body.unknowns.poses]
        return np.asarray((variances > np.square(limits)).any(axis=1))


EvaluateMoments = Callable[[BodyModel], EvaluatedMoments]
"""Gives the moments at a state."""


def fit_state(
    state: State,
    evaluate: EvaluateMoments,
    before: Callable[[BodyModel], Evidence],
    guess: Guess,
    settings: FitSettings,
    anchor: int,
    most_steps: int = MOST_STEPS,
) -> Estimate:
    """Step until nothing moves any more.

    Args:
        state: Where to begin; without a load, poses are fitted to the motion alone.
        evaluate: Moments at a state.
        before: What former chapters and expectations say at a state.
        guess: Of theta.
        settings: Of the fit.
        anchor: The robot whose pose stays what it is.
        most_steps: At most so many.
    """
    noise_of_motion: Array | None = None  # what noise adds to the information, (u, u)
    noise_of_wrench: Array | None = None
    for _ in range(most_steps):
        body, load = settings.body(state), state.load
        moments, derivatives = evaluate(body), MotionDerivatives.at(body)
        total = motion_evidence(body, derivatives, moments.motion, noise_of_motion)
        if load is not None:
            noise_of_motion = total.noise
            if moments.wrench.number > 0.0:
                by_wrench = wrench_evidence(body, derivatives, moments.wrench, load, noise_of_wrench)
                total, noise_of_wrench = total + by_wrench, by_wrench.noise
        total += before(body)
        state, seen, hidden, size, left = _step(body, total, settings, guess, anchor)
        if size > _FAR:
            noise_of_motion = noise_of_wrench = None
        if left < SMALL_ERROR:
            break
    return Estimate(settings.body(state), seen, hidden, size, guess.size)


def _step(
    body: BodyModel, total: Evidence, settings: FitSettings, guess: Guess, anchor: int
) -> tuple[State, Array, Array, float, float]:
    """One step: the new state, its covariances where it is seen and hidden, the step's size and what it leaves.

    Both are in deviations of poses; a Gauss-Newton step ``d`` leaves about ``d^2`` (rotations in rad, lengths in m).
    """
    unknowns = body.unknowns
    free = settings.free(unknowns, anchor, body.state.load is not None)
    part = total.restricted(free)
    solution = part.solve(settings.limits(unknowns.count, guess)[free])
    step, square = np.zeros(unknowns.size), np.ix_(free, free)
    seen, hidden = np.zeros((2, unknowns.size, unknowns.size))
    step[free] = solution.inverse @ part.score
    seen[square], hidden[square] = solution.seen, solution.hidden
    deviations = np.sqrt(np.maximum(seen.diagonal()[unknowns.poses], 1e-30))
    of_poses = step[unknowns.poses]
    size, left = float(np.abs(of_poses / deviations).max()), float((of_poses**2 / deviations).max())
    if settings.errors.count:
        step = step / max(1.0, float(np.abs(of_poses).max()) / _LONGEST)
    return body.state.moved(step, unknowns, _FARTHEST), seen, hidden, size, left

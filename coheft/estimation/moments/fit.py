"""The maximum-likelihood state: damped Gauss-Newton steps on poses, sensor errors, wrench offset and load together.

step = (sum of informations)^-1 (sum of scores),    sum over motion, wrench, prior
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.body import BodyModel
from coheft.estimation.moments.derivatives import WrenchDerivatives
from coheft.estimation.moments.evidence import Evidence
from coheft.estimation.moments.fit_settings import POSE_LIMITS, FitSettings, Guess
from coheft.estimation.moments.likelihood import Derivatives, MotionFactors, motion_evidence, wrench_evidence
from coheft.estimation.moments.moments import EvaluatedMoments
from coheft.estimation.moments.unknowns import Flags, State

FARTHEST = 6.0
"""Sensor errors are clipped to so many prior deviations: a gain of zero would explain everything."""
_LONGEST = 0.3
"""Steps are shortened to move no pose by more than this [rad, m]."""
_FAR = 3.0
"""After a step of so many standard deviations the noise of regressors is computed anew."""
_MOST_STEPS, _SMALL_ERROR = 10, 0.01
"""Most steps of a fit; one that leaves a smaller error, in standard deviations, is the last."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """A state and its covariance.

    Attributes:
        body: The matrices at the state.
        seen: Covariance (u, u) of all unknowns in the directions that are seen.
        hidden: Assumed covariance (u, u) in those that are not.
        inverse: Inverse of the information in the directions that are seen, shape (u, u): by how much a score moves the
            unknowns.
        step: Largest change of a pose by the last step, in its standard deviations.
        guess: Guess of the load with which it was fitted.
        is_doubtful: Whether rows count only beyond doubt, see ``Evidence.beyond_doubt``.
    """

    body: BodyModel
    seen: Array
    hidden: Array
    inverse: Array
    step: float
    guess: Guess
    is_doubtful: bool = False

    @property
    def state(self) -> State:
        """The state."""
        return self.body.state

    @property
    def covariance(self) -> Array:
        """Covariance of all unknowns, shape (u, u)."""
        return self.seen + self.hidden

    @property
    def variance_of_mass(self) -> float:
        """Variance of the mass [kg²]."""
        mass = self.body.unknowns.theta.start
        return float(self.seen[mass, mass] + self.hidden[mass, mass])

    @cached_property
    def derivatives(self) -> Derivatives:
        """Derivatives of residuals at the state, which has a load."""
        return Derivatives(self.body)

    @cached_property
    def misses_poses(self) -> bool:
        """Whether any robot's pose is hidden."""
        return bool(self.hidden_poses().any())

    def with_process_noise(self, covariance: Array) -> Estimate:
        """Return the same, less certain: unknowns have changed since, by a step with this covariance (u, u)."""
        return replace(self, seen=self.seen + covariance)

    def hidden_poses(self, limits: Array = POSE_LIMITS) -> Flags:
        """Whether a robot's pose is hidden or less certain than ``limits`` (6,) in any component, shape (N,)."""
        variances = self.covariance.diagonal()[self.body.unknowns.poses]
        return np.asarray((variances > np.square(limits)).any(axis=1))


EvaluateMoments = Callable[[BodyModel], EvaluatedMoments]
"""Computes the moments at a state."""


def fit_state(
    state: State,
    evaluate: EvaluateMoments,
    prior: Callable[[BodyModel], Evidence],
    guess: Guess,
    settings: FitSettings,
    anchor: int,
    most_steps: int = _MOST_STEPS,
) -> Estimate:
    """Fit a state to moments, beginning at one; without a load, poses are fitted to the motion alone.

    Moments and prior evidence are evaluated at each state. The pose of the robot ``anchor`` stays fixed.
    """
    noise_of_motion: Array | None = None  # what noise adds to the information, (u, u)
    noise_of_wrench: Array | None = None
    for _ in range(most_steps):
        body = settings.body(state)
        moments, factors = evaluate(body), MotionFactors.at(body)
        by_rows = motion_evidence(body, factors, moments.motion, noise_of_motion)
        if state.load is not None:
            noise_of_motion = by_rows.noise
            if moments.wrench.number > 0.0:
                by_wrench = wrench_evidence(
                    body, WrenchDerivatives.at(body, factors.derivatives), moments.wrench, noise_of_wrench
                )
                by_rows, noise_of_wrench = by_rows + by_wrench, by_wrench.noise
        estimate, state, left = _step(body, by_rows, prior(body), settings, guess, anchor)
        if estimate.step > _FAR:
            noise_of_motion = noise_of_wrench = None
        if left < _SMALL_ERROR:
            break
    return replace(estimate, body=settings.body(state))


def _step(
    body: BodyModel, by_rows: Evidence, prior: Evidence, settings: FitSettings, guess: Guess, anchor: int
) -> tuple[Estimate, State, float]:
    """Make one Gauss-Newton step.

    Returns:
        The estimate, still with the state before the step; the state after it; and the error of poses that the step
        leaves, in standard deviations: of a step ``d`` about ``d^2`` (rotations in rad, lengths in m).
    """
    unknowns = body.unknowns
    free = settings.free(unknowns, anchor, body.state.load is not None)
    limits = settings.limits(unknowns.count, guess)[free]
    part = (by_rows + prior).restricted(free)
    is_doubtful = settings.errors.count > 0 and not part.sees_all(limits)
    if is_doubtful:  # priors of sensor errors may show what rows do not
        part = by_rows.restricted(free).beyond_doubt(limits) + prior.restricted(free)
    solution = part.solve(limits)
    step, square = np.zeros(unknowns.size), np.ix_(free, free)
    seen, hidden, inverse = np.zeros((3, unknowns.size, unknowns.size))
    step[free] = solution.inverse @ part.score
    seen[square], hidden[square], inverse[square] = solution.seen, solution.hidden, solution.inverse
    deviations = np.sqrt(np.maximum(seen.diagonal()[unknowns.poses], 1e-30))
    of_poses = step[unknowns.poses]
    size, left = float(np.abs(of_poses / deviations).max()), float((of_poses**2 / deviations).max())
    if settings.errors.count:
        step = step / max(1.0, float(np.abs(of_poses).max()) / _LONGEST)
    estimate = Estimate(body, seen, hidden, inverse, size, guess, is_doubtful)
    return estimate, body.state.moved(step, unknowns, FARTHEST), left

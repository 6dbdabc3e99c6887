"""A chapter: moments of rows while nothing has changed, and a Gaussian prior from all rows before.

    prior of the next chapter = (evidence of this one's rows + its prior), with what has changed loosened by Q

A new load is ``Q_theta = infinity``, and then only the moments of wrenches end, because the poses stay what they are.
A slip is ``Q_pose = (2°, 20 mm)^2``, drift is ``q dt``. Robots that leave are eliminated, robots that join are
not known. Quadratics stay around the state of their time, and are moved to the present one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.moments.body import BodyModel
from coheft.estimation.moments.evidence import Evidence
from coheft.estimation.moments.fit import Estimate, EvaluateMoments
from coheft.estimation.moments.fit_settings import FitSettings, Guess, expected_errors
from coheft.estimation.moments.likelihood import Derivatives, motion_evidence, wrench_evidence
from coheft.estimation.moments.moments import (
    EvaluatedMoments,
    Moments,
    WrenchMoments,
    evaluated_moments,
    wrench_moments,
)
from coheft.estimation.moments.row_buffer import RowBuffer
from coheft.estimation.moments.unknowns import Indices, State, Unknowns


@dataclass(frozen=True, eq=False)
class Prior:
    """Evidence of rows that are not kept.

    Attributes:
        state: The state around which the evidence is a quadratic.
        guess: Guess of theta.
        evidence: The quadratic.
        has_expectations: Whether the prior of sensor errors is included already.
        knows_load: Whether it has information on the load.
        is_after_gap: Whether rows were missing since, so that the load may have changed.
    """

    state: State
    guess: Guess
    evidence: Evidence
    has_expectations: bool = False
    knows_load: bool = True
    is_after_gap: bool = False

    def at(self, body: BodyModel) -> Evidence:
        """Return the evidence around another state nearby."""
        return self.evidence.shifted(body.state.since(self.state, body.unknowns))

    def with_process_noise(self, indices: slice | Indices, covariance: Array) -> Prior:
        """See ``Evidence.with_process_noise``."""
        return replace(self, evidence=self.evidence.with_process_noise(indices, covariance))

    def without_load(self, unknowns: Unknowns, limits: Array) -> Prior:
        """Return the prior for another load; ``limits`` (10,) as in ``Evidence.solve``."""
        theta = np.arange(unknowns.size)[unknowns.theta]
        return replace(self, evidence=self.evidence.marginalized(theta, limits), knows_load=False)

    def for_team(self, members: Sequence[int | None], former: FitSettings, settings: FitSettings) -> Prior:
        """Convert to the prior of another team, whose sensor errors have the same parameters; ``members`` are the
        indices of its robots in the old one, None if they were not in it.

        Robots that have left are marginalized. Their offsets are no longer in the sums of the team, and those of robots
        that have joined are. Of these, only the prior of their sensor errors is known.
        """
        state, count = self.state, len(self.state.poses)
        old, new = Unknowns(count, former.errors), Unknowns(len(members), settings.errors)
        stayed = [(now, then) for now, then in enumerate(members) if then is not None]
        left = sorted(set(range(count)) - {then for _, then in stayed})
        joined = [now for now, then in enumerate(members) if then is None]
        evidence = self.evidence
        if left:
            if not self.has_expectations:
                evidence += expected_errors(old, state.eta, left)
            declared = old.eta[left][old.deviations[left] > 0.0]
            indices = np.sort(np.concatenate([old.poses[left].ravel(), declared]))
            evidence = evidence.marginalized(indices, former.limits(count, self.guess)[indices])
        kept = np.concatenate([*(old.of_robot(then) for _, then in stayed), old.common])
        indices = np.concatenate([*(new.of_robot(now) for now, _ in stayed), new.common])
        evidence = evidence.restricted(kept).embedded(new.size, indices)
        fresh = State.first([Pose.identity()] * len(members), settings.errors)
        if self.has_expectations:
            evidence += expected_errors(new, fresh.eta, joined)
        others = len(left) + len(joined)
        if settings.has_offset and others:
            of_left = former.offset_variances(left, self.guess)
            of_joined = settings.offset_variances(joined, self.guess)
            evidence = evidence.with_process_noise(new.offset, np.diag(of_left + of_joined))
        if settings.has_gyro_offset and others:
            change = max(np.max(former.gyro_offset), np.max(settings.gyro_offset)) * others / len(members)
            evidence = evidence.with_process_noise(new.gyros, change**2 * np.eye(3))
        poses, eta, calibration = list(fresh.poses), fresh.eta, fresh.calibration
        for now, then in stayed:
            poses[now], eta[now] = state.poses[then], state.eta[then]
            if calibration is not None and state.calibration is not None:
                calibration[now] = state.calibration[then]
        transported = State(tuple(poses), eta, calibration, state.gyros, state.load)
        return replace(self, state=transported, evidence=evidence)


class Chapter:
    """The present chapter of one robot: its rows, settings of fits, and the prior from earlier chapters, if there were
    any.
    """

    def __init__(self, buffer: RowBuffer, settings: FitSettings, prior: Prior | None = None) -> None:
        self.buffer, self.prior, self._settings = buffer, prior, settings

    @property
    def knows_load(self) -> bool:
        """Whether the prior has information on the load."""
        return self.prior is not None and self.prior.knows_load

    def prior_evidence(self, body: BodyModel) -> Evidence:
        """Evidence at a state from earlier chapters and from the prior of sensor errors."""
        if self.prior is None:
            return self._settings.expected(body)
        evidence = self.prior.at(body)
        return evidence if self.prior.has_expectations else evidence + self._settings.expected(body)

    def evaluation(self, end: int | None = None, keeps_motion: bool = False) -> EvaluateMoments:
        """Return a function that computes the chapter's moments at a state, without the rows from the index ``end`` on,
        or if it ``keeps_motion``, without the wrenches of these.
        """
        of_all, of_load = self.buffer.moments()
        if end is not None:
            newest = self.buffer.moments_since(end)
            is_only_load = of_all is of_load
            of_load = of_load - newest
            if not keeps_motion:
                of_all = of_load if is_only_load else of_all - newest
        return lambda body: evaluated_moments(body, of_all, of_load)

    def end_of_load(
        self,
        estimate: Estimate,
        index: int,
        keeps_poses: bool,
        noise: Array | None = None,
        step: tuple[int, Array] | None = None,
    ) -> None:
        """Start another load at this index.

        Args:
            estimate: The fit to the rows before.
            index: Of the first row of the other load.
            keeps_poses: Whether to keep what the wrenches have shown.
            noise: Covariance (u, u) by which unknowns have changed, None if theta has and may be any.
            step: Index of the first row after an earlier change of theta and the covariance of that, shape (10, 10);
                None if there was none.
        """
        unknowns, of_load = estimate.body.unknowns, self.buffer.begin_load(index)
        if keeps_poses:
            newest = of_load
            if step is not None:
                first, covariance = step
                newest = self.buffer.moments_of(self.buffer.rows[first:index])
                before_step = self._prior_with_wrenches(estimate, of_load - newest)
                self.prior = before_step.with_process_noise(unknowns.theta, covariance)
            self.prior = self._prior_with_wrenches(estimate, newest)
        if self.prior is not None:
            if noise is None:
                self.prior = self.prior.without_load(unknowns, estimate.guess.limits)
            else:
                self.prior = self.prior.with_process_noise(slice(None), noise)

    def _prior_with_wrenches(self, estimate: Estimate, moments: Moments) -> Prior:
        found = EvidenceAt(estimate.derivatives).of_wrenches(wrench_moments(estimate.body, moments))
        return self._prior_with(estimate, self._beyond_doubt(estimate, found))

    def end(self, estimate: Estimate, index: int) -> Prior:
        """Make all rows before this index, and the prior of sensor errors, part of the chapter's prior; return it."""
        of_all, of_load = self.buffer.begin_chapter(index)
        evidence = EvidenceAt(estimate.derivatives).of(evaluated_moments(estimate.body, of_all, of_load))
        evidence = self._beyond_doubt(estimate, evidence)
        if self.prior is None or not self.prior.has_expectations:
            evidence += self._settings.expected(estimate.body)
        self.prior = self._prior_with(estimate, evidence, True)
        return self.prior

    def posterior(self, estimate: Estimate, evaluate: EvaluateMoments) -> Prior:
        """Return the posterior as a prior for another robot or team; ``evaluate`` may leave out rows."""
        evidence = EvidenceAt(estimate.derivatives).of(evaluate(estimate.body))
        return self._prior_with(estimate, self._beyond_doubt(estimate, evidence))

    def _beyond_doubt(self, estimate: Estimate, evidence: Evidence) -> Evidence:
        """Evidence of rows that become part of a prior, used as in the estimate."""
        if not estimate.is_doubtful:
            return evidence
        limits = self._settings.limits(estimate.body.count, estimate.guess)
        return evidence.beyond_doubt(np.where(limits > 0.0, limits, 1.0))

    def _prior_with(self, estimate: Estimate, evidence: Evidence, has_expectations: bool = False) -> Prior:
        """Return the prior with more evidence, around the state of an estimate."""
        if self.prior is not None:
            evidence += self.prior.at(estimate.body)
            has_expectations = has_expectations or self.prior.has_expectations
        return Prior(estimate.state, estimate.guess, evidence, has_expectations)


class EvidenceAt:
    """Evidence at one state with a load; what noise adds per row is computed once.

    Args:
        derivatives: Derivatives at the state.
    """

    def __init__(self, derivatives: Derivatives) -> None:
        self._derivatives = derivatives
        self._motion_noise: Array | None = None  # what the noise of one row adds to the information, (u, u)
        self._wrench_noise: Array | None = None

    def of(self, moments: EvaluatedMoments) -> Evidence:
        """Evidence of motions and wrenches."""
        body, number = self._derivatives.body, moments.motion.number
        noise = None if self._motion_noise is None else number * self._motion_noise
        by_motion = motion_evidence(body, self._derivatives.motion, moments.motion, noise)
        if noise is None and number > 0.0:
            self._motion_noise = by_motion.noise / number
        return by_motion + self.of_wrenches(moments.wrench)

    def of_wrenches(self, moments: WrenchMoments) -> Evidence:
        """Evidence of wrenches alone."""
        number = moments.number
        noise = None if self._wrench_noise is None else number * self._wrench_noise
        by_wrench = wrench_evidence(self._derivatives.body, self._derivatives.wrench, moments, noise)
        if noise is None and number > 0.0:
            self._wrench_noise = by_wrench.noise / number
        return by_wrench

"""What was known before a change, with which the rows since then are compared."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from coheft.agents.efficient.innovations import Past
from coheft.agents.efficient.knowledge import Knowledge
from coheft.agents.efficient.unnoticed import Unnoticed
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.chapter import Prior
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.unknowns import THETA


class StateBeforeChange(NamedTuple):
    """What was known before a change.

    Attributes:
        estimate: The estimate; poses of robots that have joined since are hidden.
        prior: The same, as a prior.
        covariance: Covariance of all unknowns, shape (u, u), with the drift of sensors.
        past: The rows until then.
        unseen: Covariance (u, u) of the error if theta has changed before without having been noticed, or None.
        later: Number of later rows with which it may be compared, missing ones included; sensors drift meanwhile.
    """

    estimate: Estimate
    prior: Prior
    covariance: Array
    past: Past
    unseen: Array | None
    later: int

    @staticmethod
    def of(known: Knowledge, index: int, unnoticed: Unnoticed, later: int, missing: int = 0) -> StateBeforeChange:
        """What the rows before an index have shown; so many rows are missing after them, and ``later`` are compared."""
        estimate, prior = known.known_before(index)
        unseen = unnoticed.process_noise(known, estimate, index, missing)
        later += missing
        covariance = known.covariance_now(estimate, later)
        return StateBeforeChange(estimate, prior, covariance, known.innovations.past_before_slip, unseen, later)

    def with_poses_of(self, known: Knowledge) -> StateBeforeChange | None:
        """Return the same with the poses of robots that have joined as they are known now, because the offset of the
        total wrench depends on them; None if one is unknown.
        """
        is_new = self.estimate.hidden_poses()
        if not is_new.any():
            return self
        if known.estimate is None or known.misses_poses:
            return None
        state, now, old = self.prior.state, known.estimate.state.poses, int(np.argmin(is_new))
        to_body = state.poses[old] @ now[old].inverse()
        poses = [to_body @ now[robot] if is_new[robot] else pose for robot, pose in enumerate(state.poses)]
        there = replace(state, poses=tuple(poses))
        shift = there.since(state, self.estimate.body.unknowns)
        prior = replace(self.prior, state=there, evidence=self.prior.evidence.shifted(shift))
        estimate = known.known_from(prior)
        return self._replace(estimate=estimate, prior=prior, covariance=known.covariance_now(estimate, self.later))

    def with_load_of(self, known: Knowledge) -> StateBeforeChange:
        """Return the same at the present load, of which nothing was known: derivatives by poses depend on the load."""
        load = self.estimate.state.fitted_load.copy()
        load[THETA] = known.fitted.state.fitted_load[THETA]
        body = known.body_at(self.estimate.state.with_load(load))
        covariance, theta = self.covariance.copy(), body.unknowns.theta
        covariance[theta] = covariance[:, theta] = 0.0
        covariance[theta, theta] = np.diag(np.square(self.prior.guess.limits))
        return self._replace(estimate=replace(self.estimate, body=body), covariance=covariance)

"""What has changed: another load, a grasp that slipped, or a force or torque sensor that reads something in excess.

    S ~ N(0, V) if nothing has changed,    N(K D x, V) if unknowns have moved by D x,    x ~ N(0, 1)
    log ratio = (r^T (1 + M)^-1 r - log det (1 + M)) / 2,    M = D^T K V^-1 K D,    r = D^T K V^-1 S

with ``S`` the score of the newest rows, ``K`` their information, ``V`` its covariance, to which what the fit to older
rows does not know adds. Each suspect has a prior of its own, ``D D^T``: how far a load, a grasp or a sensor moves if it
does, or the likeliest of some shares of that. So one that explains rows with fewer or with more likely numbers wins.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.body import BodyModel
from coheft.estimation.moments.change import seen_directions
from coheft.estimation.moments.evidence import Evidence
from coheft.estimation.moments.fit_settings import Guess

SLIP: Array = np.repeat([np.radians(2.0), 0.02], 3)
"""How far a grasp slips, one standard deviation [rad, m]."""
_SHARES = 1.0, 0.1, 0.01
"""Whatever changes may do so by a share of what is said here: the likeliest one counts."""
_EXCESS = 10.0, 1.0
"""What a force or torque sensor reads in excess if it does [N, N·m]."""


class LogRatios(NamedTuple):
    """How much likelier newest rows are if something has changed, as logarithms of ratios to no change.

    Attributes:
        load: If the load has.
        slips: If the grasp of each robot has slipped, shape (N,).
        sensor: If a force or torque sensor reads something in excess, the likeliest one.
    """

    load: float
    slips: Array
    sensor: float


class _White(NamedTuple):
    """The score with what it would be without a change taken for noise of variance 1.

    Attributes:
        score: Shape (k,).
        by_change: What it becomes by a change of each unknown, shape (k, u).
    """

    score: Array
    by_change: Array

    @staticmethod
    def of(body: BodyModel, newest: Evidence, covariance: Array) -> _White:
        unknowns = body.unknowns
        places = np.concatenate([unknowns.poses.ravel(), np.arange(unknowns.size)[unknowns.load]])
        information, noise = newest.information[places], newest.noise[np.ix_(places, places)]
        basis, _ = seen_directions(information[:, places] + noise, noise)
        by_change = basis @ information
        root = np.linalg.cholesky(np.eye(len(basis)) + by_change @ covariance @ by_change.T)
        return _White(np.linalg.solve(root, basis @ newest.score[places]), np.linalg.solve(root, by_change))

    def log_ratio(self, directions: Array) -> float:
        """If unknowns have moved by ``directions`` (u, a) times numbers of variance 1, or by a share of that."""
        return max(self._log_ratio(share * directions) for share in _SHARES)

    def _log_ratio(self, directions: Array) -> float:
        moved = self.by_change @ directions
        matrix, along = np.eye(directions.shape[1]) + moved.T @ moved, moved.T @ self.score
        return 0.5 * float(along @ np.linalg.solve(matrix, along) - np.linalg.slogdet(matrix)[1])


def log_ratios(body: BodyModel, newest: Evidence, covariance: Array, guess: Guess) -> LogRatios:
    """Compare all suspects.

    Args:
        body: At the state of a fit to older rows.
        newest: What the newest rows say there.
        covariance: Of all unknowns in that fit, shape (u, u).
        guess: Of the load.
    """
    white, every, unknowns = _White.of(body, newest, covariance), np.eye(body.unknowns.size), body.unknowns
    excess = [
        every[:, unknowns.offset] @ (size * adjoint[:, part])
        for adjoint in body.adjoints
        for size, part in zip(_EXCESS, (slice(0, 3), slice(3, 6)), strict=True)
    ]
    return LogRatios(
        white.log_ratio(every[:, unknowns.theta] * guess.limits),
        np.array([white.log_ratio(every[:, own] * SLIP) for own in unknowns.poses]),
        max(map(white.log_ratio, excess)),
    )

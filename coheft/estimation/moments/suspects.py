"""Compare the causes of a change: another load, a slipped grasp, both, or an offset of a force or torque sensor.

    S ~ N(0, V) if nothing has changed,    N(K D x, V) if unknowns have moved by D x,    x ~ N(0, 1)
    log ratio = (r^T (1 + M)^-1 r - log det (1 + M)) / 2,    M = D^T K V^-1 K D,    r = D^T K V^-1 S

with ``S`` the score of the newest rows, ``K`` their information, and ``V`` the covariance of the score, which includes
the uncertainty of the fit to older rows. Each cause has its own prior covariance ``D D^T`` of the change, or the
likeliest of some shares of it. So a cause with fewer parameters, or with likelier values, wins.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.body import BodyModel
from coheft.estimation.moments.change import seen_directions
from coheft.estimation.moments.evidence import Evidence
from coheft.estimation.moments.fit_settings import Guess

SLIP: Array = np.repeat([np.radians(2.0), 0.02], 3)
"""Prior standard deviation of a slip [rad, m]."""
_SHARES = 1.0, 0.1, 0.01
"""Shares of the prior deviations that are tried; the likeliest one counts."""
_OFFSETS = 10.0, 1.0
"""Prior standard deviation of a sudden offset of a force or torque sensor [N, N·m]."""


class LogRatios(NamedTuple):
    """Log likelihood ratios of the newest rows, with a change to without.

    Attributes:
        load: If the load has changed.
        slips: If the grasp of each robot has slipped, shape (N,).
        slips_with_load: If both have happened, shape (N,); ``-inf`` unless asked for.
        sensor: If the likeliest force or torque sensor has an offset.
    """

    load: float
    slips: Array
    slips_with_load: Array
    sensor: float

    def of_slips(self, with_load: bool) -> Array:
        """Of the slip of each robot, with or without another load."""
        return self.slips_with_load if with_load else self.slips


class _White(NamedTuple):
    """The score, whitened by its covariance without a change.

    Attributes:
        score: Shape (k,).
        by_change: Its derivative by a change of each unknown, shape (k, u).
    """

    score: Array
    by_change: Array

    @staticmethod
    def of(body: BodyModel, newest: Evidence, covariance: Array) -> _White:
        unknowns = body.unknowns
        indices = np.concatenate([unknowns.poses.ravel(), np.arange(unknowns.size)[unknowns.load]])
        information, noise = newest.information[indices], newest.noise[np.ix_(indices, indices)]
        basis, _ = seen_directions(information[:, indices] + noise, noise)
        by_change = basis @ information
        root = np.linalg.cholesky(np.eye(len(basis)) + by_change @ covariance @ by_change.T)
        return _White(np.linalg.solve(root, basis @ newest.score[indices]), np.linalg.solve(root, by_change))

    def log_ratio(self, *directions: Array) -> float:
        """Return the log ratio if unknowns have changed by each of ``directions`` (u, a) times standard normals, or by
        a share of it.
        """
        moved = self.by_change @ np.hstack(directions)
        shares = np.array(list(product(_SHARES, repeat=len(directions))))
        scale = np.repeat(shares, [each.shape[1] for each in directions], axis=1)  # of each column of moved, (n, a)
        matrix = np.eye(moved.shape[1]) + scale[:, :, None] * scale[:, None] * (moved.T @ moved)
        along = scale * (moved.T @ self.score)
        squares = (along[:, None] @ np.linalg.solve(matrix, along[:, :, None])).ravel()
        return 0.5 * float((squares - np.linalg.slogdet(matrix)[1]).max())


def log_ratios(body: BodyModel, newest: Evidence, covariance: Array, guess: Guess, with_both: bool = True) -> LogRatios:
    """Compute the log ratios of all causes.

    Args:
        body: Matrices at the state of a fit to older rows.
        newest: Evidence of the newest rows there.
        covariance: Covariance of all unknowns in that fit, shape (u, u).
        guess: Guess of the load.
        with_both: Whether to compute ``slips_with_load``.
    """
    white, every, unknowns = _White.of(body, newest, covariance), np.eye(body.unknowns.size), body.unknowns
    offsets = [
        every[:, unknowns.offset] @ (size * adjoint[:, part])
        for adjoint in body.adjoints
        for size, part in zip(_OFFSETS, (slice(0, 3), slice(3, 6)), strict=True)
    ]
    load, slips = every[:, unknowns.theta] * guess.limits, [every[:, own] * SLIP for own in unknowns.poses]
    return LogRatios(
        white.log_ratio(load),
        np.array([white.log_ratio(slip) for slip in slips]),
        np.array([white.log_ratio(load, slip) if with_both else -np.inf for slip in slips]),
        max(map(white.log_ratio, offsets)),
    )

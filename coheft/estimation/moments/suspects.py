"""Compare the causes of a change: another load, a slipped grasp, both, or an offset of a force or torque sensor.

    S ~ N(0, V) if nothing has changed,    N(K D x, V) if unknowns have moved by D x,    x ~ N(0, 1)
    log ratio = (r^T (1 + M)^-1 r - log det (1 + M)) / 2,    M = D^T K V^-1 K D,    r = D^T K V^-1 S

with ``S`` the score of the newest rows, ``K`` their information, and ``V`` the covariance of the score, which includes
the uncertainty of the fit to older rows. Each cause has its own prior covariance ``D D^T`` of the change, or the
likeliest of some shares of it. So a cause with fewer parameters, or with likelier values, wins.

Residuals of single rows say which row is the first after a slip, and whether the grasp has slipped at all:

    log ratio of two causes = sum over rows of (r_2^T V^-1 r_2 - r_1^T V^-1 r_1) / 2
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np

from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.moments.body import (
    FORCING,
    MOTION_SIZE,
    REGRESSOR,
    BodyModel,
    load_operator,
    residual_covariance,
)
from coheft.estimation.moments.evidence import Evidence, seen_directions
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.fit_settings import Guess
from coheft.estimation.moments.moments import robot_indices
from coheft.estimation.moments.unknowns import THETA

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
    """The score (k,), whitened by its covariance without a change, and its derivative by a change of each unknown, (k,
    u).
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
    """Compute the log ratios of all causes, but ``slips_with_load`` only if asked for, from evidence of the newest rows
    at the state of ``body``: that of a fit to older rows, in which the unknowns have this covariance (u, u).
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


def latest_start(before: Estimate, after: Estimate, rows: Array, mean: Array, lead: float) -> int:
    """Return the index of the last of rows (n, X) that may well be the first one after a slip: by the estimates before
    and after it, no other is likelier by the log ratio ``lead``.

    ``mean`` (12 N,) are mean residuals of motion sensors, in units of their noise.
    """
    of_before, of_after = (_squares(estimate, rows, mean) for estimate in (before, after))
    ratios = np.cumsum(0.5 * (of_before - of_after)[::-1])[::-1]  # if each row is the first one
    return int(np.flatnonzero(ratios >= ratios.max() - lead)[-1])


def log_ratio_to_knock(estimate: Estimate, robot: int, former_pose: Pose, rows: Array, is_load: bool) -> float:
    """Return the log ratio of wrenches: the grasp has slipped, to only its motion sensors have been knocked.

    Sensors that are knocked out of place read the motion as if the grasp had slipped, but the wrench still acts where
    it did. If the load has changed as well, each is with the load that fits best.

    Args:
        estimate: The estimate after the slip.
        robot: Index of the robot.
        former_pose: The pose of its grasp before.
        rows: Rows of the team since then, shape (n, X).
        is_load: Whether the load has changed as well.
    """
    body, load = estimate.body, estimate.state.fitted_load
    root = np.linalg.cholesky(residual_covariance(body, load))
    motion, own = rows @ body.motion_map[FORCING].T, robot_indices(body.count, body.unknowns.errors)[robot]
    to_former = former_pose.adjoint() @ estimate.state.poses[robot].inverse().adjoint()
    knocked = body.wrench_map.copy()
    knocked[:, own] = to_former @ knocked[:, own]
    needed = motion @ load_operator(load).T
    of_slip, of_knock = (np.linalg.solve(root, (rows @ each.T - needed).T) for each in (body.wrench_map, knocked))
    if is_load:
        by_theta = np.tensordot(motion, np.linalg.solve(root, REGRESSOR[:, :, THETA]), axes=1)  # (n, 6, 10)
        basis, _ = np.linalg.qr(by_theta.reshape(-1, by_theta.shape[2]))
        of_slip, of_knock = (each.T.ravel() - basis @ (basis.T @ each.T.ravel()) for each in (of_slip, of_knock))
    return 0.5 * float(np.square(of_knock).sum() - np.square(of_slip).sum())


def _squares(estimate: Estimate, rows: Array, mean: Array) -> Array:
    """Squared residuals (n,) of rows (n, X) at an estimate, with these mean residuals of motion sensors."""
    body, load = estimate.body, estimate.state.fitted_load
    motion = rows @ body.motion_map.T
    of_motion = body.residuals(rows, motion[:, :MOTION_SIZE]).reshape(len(rows), -1) - mean
    wrench = (rows @ body.wrench_map.T - motion[:, FORCING] @ load_operator(load).T).T
    of_wrench = np.linalg.solve(np.linalg.cholesky(residual_covariance(body, load)), wrench)
    result: Array = np.square(of_motion).sum(axis=1) + np.square(of_wrench).sum(axis=0)
    return result

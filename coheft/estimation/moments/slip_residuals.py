"""By residuals of single rows: which row is the first after a slip, and has the grasp slipped at all?

    log ratio of two causes = sum over rows of (r_2^T V^-1 r_2 - r_1^T V^-1 r_1) / 2

Sensors that are knocked out of place read the motion as if the grasp had slipped, but the wrench still acts where it
did.
"""

from __future__ import annotations

import numpy as np

from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.moments.body import FORCING, MOTION_SIZE, REGRESSOR, load_operator, residual_covariance
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.moments import robot_indices
from coheft.estimation.moments.unknowns import THETA


def latest_start(before: Estimate, after: Estimate, rows: Array, mean: Array, lead: float) -> int:
    """Return the index of the last row that may well be the first one after a slip.

    Args:
        before: The estimate before the slip.
        after: The estimate after it.
        rows: Rows of the team, shape (n, X).
        mean: Mean residuals of motion sensors, in units of their noise, shape (12 N,).
        lead: Log ratio by which another row has to be likelier.
    """
    of_before, of_after = (_squares(estimate, rows, mean) for estimate in (before, after))
    ratios = np.cumsum(0.5 * (of_before - of_after)[::-1])[::-1]  # if each row is the first one
    return int(np.flatnonzero(ratios >= ratios.max() - lead)[-1])


def log_ratio_to_knock(estimate: Estimate, robot: int, former_pose: Pose, rows: Array, is_load: bool) -> float:
    """Return the log ratio of wrenches: the grasp has slipped, to only its motion sensors have been knocked.

    If the load has changed as well, each is with the load that fits best.

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

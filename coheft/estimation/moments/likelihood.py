"""Score and information of all unknowns from moments of rows: two least-squares problems, the motion eliminated.

    motion:  r_i = y_i - predict_i psi,    information = sum D^T (W - W B (B^T W B)^-1 B^T W) D
    wrench:  rho = sum_i Ad(g_i) u_i - X(psi) theta - offset,    information = sum D^T Sigma^-1 D

Sums over rows are products of derivatives with moments, so no row is visited again. The known contribution of the noise
of ``psi`` and of the wrenches to the moments is subtracted.
"""

from __future__ import annotations

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.linear_algebra import inverse as inverse_of
from coheft.estimation.moments import rows
from coheft.estimation.moments.body import PRODUCTS, REGRESSOR, BodyModel, residual_covariance
from coheft.estimation.moments.derivatives import MotionDerivatives, WrenchDerivatives
from coheft.estimation.moments.evidence import Evidence
from coheft.estimation.moments.moments import MotionMoments, WrenchMoments
from coheft.estimation.moments.unknowns import LOAD_SIZE, Indices


def motion_evidence(
    body: BodyModel,
    derivatives: MotionDerivatives,
    moments: MotionMoments,
    noise: Array | None = None,
) -> Evidence:
    """Evidence of motion sensors on all unknowns.

    Means of twists are removed, so constant errors of gyros and velocities have no effect.

    Args:
        body: Matrices at the state.
        derivatives: Derivatives there.
        moments: Moments there.
        noise: Contribution of the regressors' noise to the information (u, u), if known from a state nearby.
    """
    unknowns, count, own, number = body.unknowns, body.count, body.unknowns.own, moments.number
    of_motion = moments.of_motion
    means = of_motion[0] / max(number, 1.0)
    residual = moments.with_motion - body.predict @ of_motion[: body.predict.shape[2]]
    residual[:, rows.TWIST] -= residual[:, rows.TWIST, :1] * means
    if body.residual_noise is not None:
        residual -= number * body.residual_noise
    weighted = body.weight[:, :, None] * residual
    score = np.zeros(unknowns.size)
    score[: count * own] = (derivatives.own.reshape(count, own, -1) @ weighted.reshape(count, -1, 1)).ravel()
    on_products = body.predict[:, rows.ACCELERATIONS, PRODUCTS].swapaxes(1, 2)
    of_products = (on_products @ weighted[:, rows.ACCELERATIONS]).sum(axis=0)
    motion = unknowns.motion_size
    score[:motion] += (derivatives.common * of_products).reshape(motion, -1).sum(axis=1)

    of_noise = number * body.motion_noise
    clean = of_motion - of_noise
    if noise is None:
        noise = _motion_information(body, derivatives, of_noise, of_noise)
    information = _motion_information(body, derivatives, clean - of_motion[:, :1] * means, clean)
    return Evidence.of_rows(score, information, noise, number)


def _motion_information(
    body: BodyModel, derivatives: MotionDerivatives, of_twist: Array, of_accelerations: Array
) -> Array:
    """Information (u, u) of motion sensors from moments of ``psi`` (features, features), for both fusions.

    A fusion's part is ``sum_i tr(D_i^T W_i D_i G)`` with the derivatives ``D_i`` of predictions of robot i, less what a
    change of the motion explains of it: ``tr(F^T C F G)`` with ``F = sum_i B_i^T W_i D_i``, named ``found``.
    """
    unknowns, count, own = body.unknowns, body.count, body.unknowns.own
    of_robots, motion = count * own, unknowns.motion_size
    result, alone = np.zeros((unknowns.size, unknowns.size)), np.zeros((count, own, own))
    twist, fusion = body.twist, body.accelerations
    for each, gram in ((twist, of_twist), (fusion, of_accelerations)):
        part = derivatives.own[:, :, each.sensors]
        used = np.flatnonzero(part.any(axis=(0, 1, 2)))
        part = part[..., used]
        by_gram = each.weight[:, None, :, None] * (part @ gram[used[:, None], used])
        alone += by_gram.reshape(count, own, -1) @ part.reshape(count, own, -1).swapaxes(1, 2)

    found = (twist.weighted.swapaxes(1, 2)[:, None] @ derivatives.own[:, :, twist.sensors]).reshape(of_robots, 6, -1)
    used = np.arange(1, body.features)
    result[:of_robots, :of_robots] -= _summed_product(twist.covariance @ found, of_twist, found, used)
    used, found = body.without_velocity, derivatives.found
    result[:motion, :motion] -= _summed_product(fusion.covariance @ found, of_accelerations, found, used)

    # Predictions change by the products as well: own times common, and half of common times common.
    weighted = (fusion.weight[:, :, None] * body.predict[:, rows.ACCELERATIONS, PRODUCTS]).swapaxes(1, 2)
    weighted_changes = np.zeros_like(derivatives.common)
    weighted_changes[:of_robots] = (weighted[:, None] @ derivatives.own[:, :, fusion.sensors]).reshape(of_robots, 6, -1)
    weighted_changes += (
        0.5 * (weighted @ body.predict[:, rows.ACCELERATIONS, PRODUCTS]).sum(axis=0) @ derivatives.common
    )
    across = _summed_product(derivatives.common, of_accelerations, weighted_changes, used)
    result[:motion, :motion] += across + across.T
    _add_along_diagonal(result[:of_robots, :of_robots], alone)
    symmetric: Array = 0.5 * (result + result.T)
    return symmetric


def _add_along_diagonal(matrix: Array, blocks: Array) -> None:
    """Add blocks (N, k, k) to those on the diagonal of a matrix (k N, k N), in place."""
    count, size, _ = blocks.shape
    matrix.reshape(count, size, count, size)[range(count), :, range(count)] += blocks


def _summed_product(left: Array, gram: Array, right: Array, used: Indices) -> Array:
    """Compute ``sum tr(left_k gram right_l^T)`` over the features ``used``: (k, 6, f), (l, 6, f) to (k, l)."""
    of_left, of_right = left.take(used, axis=-1), right.take(used, axis=-1)
    by_gram = of_left.reshape(-1, len(used)) @ gram[used[:, None], used]  # one product is faster than one for each k
    result: Array = by_gram.reshape(len(left), -1) @ of_right.reshape(len(right), -1).T
    return result


def wrench_evidence(
    body: BodyModel,
    motion: MotionDerivatives,
    moments: WrenchMoments,
    noise: Array | None = None,
) -> Evidence:
    """Evidence of the total wrench on all unknowns; internal forces show the poses as well.

    Args:
        body: Matrices at the state, which has a load.
        motion: Derivatives there.
        moments: Moments there.
        noise: Contribution of the regressors' noise to the information (u, u), if known from a state nearby.
    """
    number, of_robots = moments.number, body.count * body.unknowns.own
    weight = inverse_of(residual_covariance(body, body.state.fitted_load))
    root: Array = np.asarray(np.linalg.cholesky(weight)).T.astype(np.float64)
    derivatives = WrenchDerivatives.at(body, motion, root)
    clean = _without_noise(body, moments)
    information = _common_information(derivatives, clean, body.without_velocity)
    information[:of_robots, :of_robots] += _local_information(derivatives.local, clean.of_wrenches)
    if noise is None:
        noise = _wrench_noise(body, derivatives, number)
    return Evidence.of_rows(_wrench_score(derivatives, clean), information, noise, number)


def _without_noise(body: BodyModel, moments: WrenchMoments) -> WrenchMoments:
    """Return the moments less the contribution of the noise of wrenches and of ``psi``."""
    number, of_wrenches = moments.number, moments.of_wrenches.copy()
    _add_along_diagonal(of_wrenches, -number * body.wrench_covariance)
    return WrenchMoments(of_wrenches, moments.with_motion, moments.of_motion - number * body.motion_noise)


def _wrench_score(derivatives: WrenchDerivatives, moments: WrenchMoments) -> Array:
    """Score ``-sum rho . (d rho / d k)``, shape (u,)."""
    local, (count, own, _, size) = derivatives.local, derivatives.local.shape
    by_wrenches, by_motion = derivatives.of_wrenches, derivatives.of_motion
    with_wrenches = by_wrenches @ moments.of_wrenches + by_motion @ moments.with_motion.T  # sum rho u^T
    with_motion = by_wrenches @ moments.with_motion + by_motion @ moments.of_motion  # sum rho psi^T
    score: Array = -(derivatives.common.reshape(len(derivatives.common), -1) @ with_motion.ravel())
    by_robot = with_wrenches.reshape(6, count, size).transpose(1, 0, 2).reshape(count, -1, 1)
    score[: count * own] -= (local.reshape(count, own, -1) @ by_robot).ravel()
    return score


def _local_information(local: Array, of_wrenches: Array) -> Array:
    """``tr(local_k G_ij local_l^T)`` with ``G_ij = sum u_i u_j^T``, k of robot i and l of robot j: (own N, own N)."""
    count, own, _, size = local.shape
    by_gram = local.reshape(count, own * 6, size) @ of_wrenches.reshape(count, size, -1)
    by_other = by_gram.reshape(count * own, 6, count, size).transpose(2, 0, 1, 3)  # robot j, unknown k, 6, w
    blocks = by_other.reshape(count, -1, 6 * size) @ local.reshape(count, own, 6 * size).swapaxes(1, 2)
    result = blocks.transpose(1, 0, 2).reshape(count * own, -1)
    symmetric: Array = 0.5 * (result + result.T)
    return symmetric


def _common_information(derivatives: WrenchDerivatives, moments: WrenchMoments, used: Indices) -> Array:
    """``C + C^T``, ``C_kl = tr((local_k sum u psi^T + 1/2 common_k sum psi psi^T) common_l^T)``, shape (u, u).

    Args:
        derivatives: Derivatives of the residual.
        moments: Moments without noise.
        used: Entries of ``psi`` that the wrench depends on.
    """
    local, common, (count, own, _, size) = derivatives.local, derivatives.common[..., used], derivatives.local.shape
    by_gram = 0.5 * (common @ moments.of_motion[used[:, None], used])
    by_own = local.reshape(count, own * 6, size) @ moments.with_motion[:, used].reshape(count, size, -1)
    by_gram[: count * own] += by_own.reshape(count * own, 6, -1)
    result: Array = by_gram.reshape(len(common), -1) @ common.reshape(len(common), -1).T
    return result + result.T


def _wrench_noise(body: BodyModel, derivatives: WrenchDerivatives, number: float) -> Array:
    """Contribution of the noise of motion and wrenches to the information of ``number`` rows, shape (u, u)."""
    count, own = body.count, body.unknowns.own
    local, common, used = derivatives.local, derivatives.common, body.without_velocity
    of_robots, of_noise = count * own, number * body.motion_noise
    noise = _summed_product(common, of_noise, common, used)
    weighted = (local @ (number * body.wrench_covariance)[:, None]).reshape(count, own, -1)
    by_own = weighted @ local.reshape(count, own, -1).swapaxes(1, 2)
    _add_along_diagonal(noise[:of_robots, :of_robots], by_own)
    symmetric: Array = 0.5 * (noise + noise.T)
    return symmetric


def information_table(weight: Array) -> Array:
    """Return the map from Gram matrices (169,) of ``motion[FORCING]`` to the load's information (256,).

    Args:
        weight: Information of the residual of the total wrench in one row, shape (6, 6).

    Returns:
        Shape (169, 256).
    """
    size = len(REGRESSOR)
    flat = REGRESSOR.transpose(1, 0, 2).reshape(6, -1)
    table = (flat.T @ weight @ flat).reshape(size, LOAD_SIZE, size, LOAD_SIZE)
    return np.ascontiguousarray(table.transpose(0, 2, 1, 3)).reshape(size * size, -1)

"""Score and information of all unknowns from moments of rows: two least-squares problems, the motion eliminated.

    motion:  r_i = y_i - predict_i psi,    information = sum D^T (W - W B (B^T W B)^-1 B^T W) D
    wrench:  rho = sum_i Ad(g_i) u_i - X(psi) theta - offset,    information = sum D^T Sigma^-1 D

Sums over rows are products of derivatives with moments, so no row is visited again. The known contribution of the noise
of ``psi`` and of the wrenches to the moments is subtracted.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.linear_algebra import inverse as inverse_of
from coheft.estimation.moments import rows
from coheft.estimation.moments.body import PRODUCTS, REGRESSOR, BodyModel, residual_covariance
from coheft.estimation.moments.derivatives import (
    COMMON,
    FOUND,
    FOUND_TWIST,
    WEIGHTED,
    MotionDerivatives,
    WrenchDerivatives,
)
from coheft.estimation.moments.evidence import Evidence
from coheft.estimation.moments.moments import MotionMoments, WrenchMoments
from coheft.estimation.moments.unknowns import LOAD_SIZE


class Products(NamedTuple):
    """Information between m and m' unknowns as products of factors, so that parts of it can be computed alone.

    The first N k of the m unknowns are k own ones of each robot, one robot after another; so are N k' of the m'.

    Attributes:
        left, right: ``left right^T`` is what all unknowns have, shapes (m, f) and (m', f).
        own_left, own_right: ``own_left_i own_right_i^T`` is added for robot i's own ones, shapes (N, k, g), (N, k', g).
    """

    left: Array
    right: Array
    own_left: Array
    own_right: Array

    def all(self) -> Array:
        """Compute all of it, shape (m, m')."""
        result: Array = self.left @ self.right.T
        count, own, _ = self.own_left.shape
        of_robots = result[: count * own, : count * self.own_right.shape[1]]
        blocks = self.own_left @ self.own_right.swapaxes(1, 2)
        of_robots.reshape(count, own, count, -1)[range(count), :, range(count)] += blocks
        return result

    def groups(self, size: int) -> Array:
        """Compute the parts of groups of so many own unknowns of a robot, shape (N k / size, size, size)."""
        left, right, own_left, own_right = (each.reshape(-1, size, each.shape[-1]) for each in self)
        result: Array = left @ right.swapaxes(1, 2) + own_left @ own_right.swapaxes(1, 2)
        return result


class Grams(NamedTuple):
    """Moments of ``psi`` for the fusions of twists and of accelerations, shape (features, features) each."""

    twist: Array
    accelerations: Array


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
    size, motion = body.unknowns.size, body.unknowns.motion_size
    score, information = np.zeros(size), np.zeros((size, size))
    clean, of_noise = motion_grams(body, moments)
    score[:motion] = motion_score(body, derivatives, moments)
    information[:motion, :motion] = _symmetric(motion_products(body, derivatives, derivatives, clean).all())
    if noise is None:
        noise = np.zeros((size, size))
        noise[:motion, :motion] = _symmetric(motion_products(body, derivatives, derivatives, of_noise).all())
    return Evidence.of_rows(score, information, noise, moments.number)


def _symmetric(matrix: Array) -> Array:
    """Return the matrix symmetric to the last bit."""
    result: Array = 0.5 * (matrix + matrix.T)
    return result


def motion_score(body: BodyModel, derivatives: MotionDerivatives, moments: MotionMoments) -> Array:
    """Score of motion sensors, shape (m,)."""
    count, own, number, of_motion = body.count, derivatives.own.shape[1], moments.number, moments.of_motion
    residual = moments.with_motion - body.predict @ of_motion[: body.predict.shape[2]]
    residual[:, rows.TWIST] -= residual[:, rows.TWIST, :1] * (of_motion[0] / max(number, 1.0))
    if body.residual_noise is not None:
        residual -= number * body.residual_noise
    weighted = body.weight[:, :, None] * residual
    on_products = body.predict[:, rows.ACCELERATIONS, PRODUCTS].swapaxes(1, 2)
    of_products = (on_products @ weighted[:, rows.ACCELERATIONS]).sum(axis=0)
    score: Array = (derivatives.common * of_products).reshape(len(derivatives.common), -1).sum(axis=1)
    score[: count * own] += (derivatives.own.reshape(count, own, -1) @ weighted.reshape(count, -1, 1)).ravel()
    return score


def motion_grams(body: BodyModel, moments: MotionMoments) -> tuple[Grams, Grams]:
    """Return the moments of ``psi`` less those of its noise, and those of its noise; twists are less their means."""
    of_motion, of_noise = moments.of_motion, moments.number * body.motion_noise
    clean, means = of_motion - of_noise, of_motion[0] / max(moments.number, 1.0)
    return Grams(clean - of_motion[:, :1] * means, clean), Grams(of_noise, of_noise)


def motion_products(body: BodyModel, left: MotionDerivatives, right: MotionDerivatives, grams: Grams) -> Products:
    """Information of motion sensors between the unknowns of two derivatives at the same state.

    A fusion's part is ``sum_i tr(D_i^T W_i D_i G)`` with the derivatives ``D_i`` of predictions of robot i, less what a
    change of the motion explains of it: ``tr(F^T C F G)`` with ``F = sum_i B_i^T W_i D_i``, named ``found``.
    Predictions change by the products as well: own times common, and half of common times common.
    """
    of_team = np.empty_like(left.of_team)
    of_team[:, FOUND_TWIST] = -body.twist.covariance @ left.of_team[:, FOUND_TWIST]
    of_team[:, FOUND] = -body.accelerations.covariance @ left.found
    of_team[:, COMMON], of_team[:, WEIGHTED] = left.of_team[:, WEIGHTED], left.common
    own, used = body.weight[:, None, :, None] * left.own, (body.of_twist, body.without_velocity)

    def factor(array: Array, grams: Grams | None = None) -> Array:
        parts = []
        for part, entries, gram in zip(
            (array[..., :6, :], array[..., 6:, :]), used, grams or (None, None), strict=True
        ):
            part = part.take(entries, axis=-1)
            if gram is not None:
                part = part.reshape(-1, len(entries)) @ gram[entries[:, None], entries]
            parts.append(part.reshape(*array.shape[:-2], -1))
        return np.concatenate(parts, axis=-1)

    return Products(factor(of_team, grams), factor(right.of_team), factor(own, grams), factor(right.own))


def _flat(array: Array) -> Array:
    """Return the array with its last two axes as one."""
    result: Array = array.reshape(*array.shape[:-2], -1)
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
    derivatives, clean = WrenchDerivatives.at(body, motion, whitening(body)), without_noise(body, moments)
    information = _symmetric(wrench_information(body, derivatives, derivatives, clean))
    if noise is None:
        noise = _symmetric(noise_products(body, derivatives, derivatives, moments.number).all())
    return Evidence.of_rows(wrench_score(derivatives, clean), information, noise, moments.number)


def whitening(body: BodyModel) -> Array:
    """Return the matrix (6, 6) that whitens the residual of the total wrench at a state with a load."""
    weight = inverse_of(residual_covariance(body, body.state.fitted_load))
    root: Array = np.asarray(np.linalg.cholesky(weight)).T.astype(np.float64)
    return root


def without_noise(body: BodyModel, moments: WrenchMoments) -> WrenchMoments:
    """Return the moments less the contribution of the noise of wrenches and of ``psi``."""
    number, count, of_wrenches = moments.number, body.count, moments.of_wrenches.copy()
    blocks = of_wrenches.reshape(count, -1, count, of_wrenches.shape[1] // count)
    blocks[range(count), :, range(count)] -= number * body.wrench_covariance
    return WrenchMoments(of_wrenches, moments.with_motion, moments.of_motion - number * body.motion_noise)


def wrench_score(derivatives: WrenchDerivatives, moments: WrenchMoments) -> Array:
    """Score ``-sum rho . (d rho / d k)``, shape (u,)."""
    local, (count, own, _, size) = derivatives.local, derivatives.local.shape
    by_wrenches, by_motion = derivatives.of_wrenches, derivatives.of_motion
    with_wrenches = by_wrenches @ moments.of_wrenches + by_motion @ moments.with_motion.T  # sum rho u^T
    with_motion = by_wrenches @ moments.with_motion + by_motion @ moments.of_motion  # sum rho psi^T
    score: Array = -(derivatives.common.reshape(len(derivatives.common), -1) @ with_motion.ravel())
    by_robot = with_wrenches.reshape(6, count, size).transpose(1, 0, 2).reshape(count, -1, 1)
    score[: count * own] -= (local.reshape(count, own, -1) @ by_robot).ravel()
    return score


def wrench_products(
    body: BodyModel, left: WrenchDerivatives, right: WrenchDerivatives, moments: WrenchMoments
) -> Products:
    """Information of the total wrench between the unknowns of two derivatives, by clean moments.

    It is ``tr(D_k G D_l^T)`` with derivatives ``D`` by ``u`` and ``psi`` together; here without ``u_i u_j^T``, i != j.
    """
    count, own, _, size = left.local.shape
    of_wrenches = moments.of_wrenches.reshape(count, size, count, size)[range(count), :, range(count)]
    by_wrenches = left.local.reshape(count, own * 6, size) @ of_wrenches
    (by_left, of_left), (by_right, of_right) = (_factors(body, each, moments) for each in (left, right))
    together = np.hstack([by_left, of_left]), np.hstack([of_right, by_right])
    return Products(*together, by_wrenches.reshape(count, own, -1), _flat(right.local))


def _factors(body: BodyModel, derivatives: WrenchDerivatives, moments: WrenchMoments) -> tuple[Array, Array]:
    """``local sum u psi^T + 1/2 common sum psi psi^T``, and ``common``, shapes (u, f)."""
    used, (count, own, _, size) = body.without_velocity, derivatives.local.shape
    common = derivatives.common.take(used, axis=-1)
    result = 0.5 * (common @ moments.of_motion[used[:, None], used])
    by_own = derivatives.local.reshape(count, own * 6, size) @ moments.with_motion[:, used].reshape(count, size, -1)
    result[: count * own] += by_own.reshape(count * own, 6, -1)
    return _flat(result), _flat(common)


def wrench_information(
    body: BodyModel, left: WrenchDerivatives, right: WrenchDerivatives, moments: WrenchMoments
) -> Array:
    """Information of the total wrench between the unknowns of two derivatives, by clean moments, shape (u, u')."""
    (by_left, of_left), (count, own, _, size) = _factors(body, left, moments), left.local.shape
    by_right, of_right = (by_left, of_left) if right is left else _factors(body, right, moments)
    result: Array = by_left @ of_right.T
    result = result + (result.T if right is left else of_left @ by_right.T)
    by_gram = left.local.reshape(count, own * 6, size) @ moments.of_wrenches.reshape(count, size, -1)
    by_other = by_gram.reshape(count * own, 6, count, size).transpose(2, 0, 1, 3)  # robot j, unknown k, 6, w
    blocks = by_other.reshape(count, -1, 6 * size) @ _flat(right.local).swapaxes(1, 2)
    between = blocks.transpose(1, 0, 2).reshape(count * own, -1)
    result[: count * own, : between.shape[1]] += between
    return result


def noise_products(body: BodyModel, left: WrenchDerivatives, right: WrenchDerivatives, number: float) -> Products:
    """What the noise of motion and wrenches adds to the information of ``number`` rows."""
    used, (count, own, _, size) = body.without_velocity, left.local.shape
    by_own = left.local.reshape(count, own * 6, size) @ (number * body.wrench_covariance)
    local = by_own.reshape(left.local.shape)
    commons = [each.common.take(used, axis=-1) for each in (left, right)]
    by_noise = commons[0] @ (number * body.motion_noise[used[:, None], used])
    return Products(*(_flat(each) for each in (by_noise, commons[1], local, right.local)))


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

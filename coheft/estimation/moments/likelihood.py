"""Score and information of all unknowns from moments of rows: two least-squares problems, the motion eliminated.

    motion:  r_i = y_i - predict_i psi,    information = sum D^T (W - W B (B^T W B)^-1 B^T W) D
    wrench:  rho = sum_i Ad(g_i) u_i - X(psi) theta - offset,    information = sum D^T Sigma^-1 D

Sums over rows are products of derivatives with moments, so no row is visited again. The known contribution of the noise
of ``psi`` and of the wrenches to the moments is subtracted. An information is a product of two factors, so that parts
of it can be computed without the rest:

    information = left right^T,    and between own unknowns of robot i also own_left_i own_right_i^T
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import NamedTuple

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments import rows
from coheft.estimation.moments.body import PRODUCTS, REGRESSOR, BodyModel
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
from coheft.estimation.moments.unknowns import LOAD_SIZE, Indices


class Factor(NamedTuple):
    """A factor for m unknowns: k own ones of each robot, those of one robot after another, then common ones.

    Attributes:
        team: Parts for all unknowns, shapes (m, f).
        own: Parts for robots' own unknowns that only meet those of the same robot, shapes (N, k, f).
    """

    team: tuple[Array, ...]
    own: tuple[Array, ...]

    @staticmethod
    def of(team: Iterable[Array], own: Iterable[Array]) -> Factor:
        """Of parts of which the last two axes become one, ``f``."""
        return Factor(*(tuple(part.reshape(*part.shape[:-2], -1) for part in parts) for parts in (team, own)))

    def times(self, right: Factor) -> Array:
        """Compute the information between these m unknowns and m' others, shape (m, m')."""
        result = _sum_of_products(self.team, right.team)
        blocks = _sum_of_products(self.own, right.own)
        count, own, others = blocks.shape
        of_robots = result[: count * own, : count * others].reshape(count, own, count, others)
        of_robots[range(count), :, range(count)] += blocks
        return result

    def groups_times(self, right: Factor, size: int) -> Array:
        """Compute the information of each group of so many own unknowns, shape (N k / size, size, size).

        Both factors have no common unknowns.
        """
        left, other = (
            [part.reshape(-1, size, part.shape[-1]) for part in (*each.team, *each.own)] for each in (self, right)
        )
        return _sum_of_products(left, other)


def _sum_of_products(left: Iterable[Array], right: Iterable[Array]) -> Array:
    products = [one @ np.swapaxes(other, -1, -2) for one, other in zip(left, right, strict=True)]
    result = products[0]
    for product in products[1:]:
        result += product
    return result


class Grams(NamedTuple):
    """Moments of ``psi`` for the fusions of twists and of accelerations, shape (features, features) each."""

    twist: Array
    accelerations: Array


def motion_evidence(
    body: BodyModel,
    factors: MotionFactors,
    moments: MotionMoments,
    noise: Array | None = None,
) -> Evidence:
    """Evidence of motion sensors on all unknowns, from factors and moments at the state of ``body``.

    Means of twists are removed, so constant errors of gyros and velocities have no effect. ``noise`` is what that of
    the regressors adds to the information (u, u), if it is known from a state nearby.
    """
    size, motion = body.unknowns.size, body.unknowns.motion_size
    score, information = np.zeros(size), np.zeros((size, size))
    clean = motion_grams(body, moments)
    score[:motion] = motion_score(body, factors.derivatives, moments)
    information[:motion, :motion] = _symmetric(factors.left(clean).times(factors.right))
    if noise is None:
        noise = np.zeros((size, size))
        noise[:motion, :motion] = _symmetric(factors.left(noise_grams(body, moments.number)).times(factors.right))
    return Evidence.of_rows(score, information, noise, moments.number)


def _symmetric(matrix: Array) -> Array:
    """Return the matrix symmetric to the last bit."""
    return 0.5 * (matrix + matrix.T)


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


def motion_grams(body: BodyModel, moments: MotionMoments) -> Grams:
    """Return the moments of ``psi`` without its noise, for twists also without means."""
    of_motion, means = moments.of_motion, moments.of_motion[0] / max(moments.number, 1.0)
    clean = of_motion - moments.number * body.motion_noise
    return Grams(clean - of_motion[:, :1] * means, clean)


def noise_grams(body: BodyModel, number: float) -> Grams:
    """Return what noise adds to the moments of ``psi`` of so many rows."""
    of_noise = number * body.motion_noise
    return Grams(of_noise, of_noise)


class MotionFactors(NamedTuple):
    """Factors of the information of motion sensors.

    A fusion's part is ``sum_i tr(D_i^T W_i D_i G)`` with the derivatives ``D_i`` of predictions of robot i, less what a
    change of the motion explains of it: ``tr(F^T C F G)`` with ``F = sum_i B_i^T W_i D_i``, named ``found``.
    Predictions change by the products as well: own times common, and half of common times common.

    Attributes:
        derivatives: As given.
        right: The right factor.
        team, own: Parts of the left one, of twists and of accelerations, before they are multiplied by moments ``G``.
        used: Entries of ``psi`` on which they depend.
    """

    derivatives: MotionDerivatives
    right: Factor
    team: tuple[Array, Array]
    own: tuple[Array, Array]
    used: tuple[Indices, Indices]

    @staticmethod
    def at(body: BodyModel) -> MotionFactors:
        """Compute them for the unknowns of the motion at the state of ``body``."""
        return MotionFactors.of(body, MotionDerivatives.at(body))

    @staticmethod
    def of(body: BodyModel, derivatives: MotionDerivatives) -> MotionFactors:
        """Compute them for the unknowns of ``derivatives``."""
        used, of_team = (body.of_twist, body.without_velocity), np.empty_like(derivatives.of_team)
        of_team[:, FOUND_TWIST] = -body.twist.covariance @ derivatives.of_team[:, FOUND_TWIST]
        of_team[:, FOUND] = -body.accelerations.covariance @ derivatives.found
        of_team[:, COMMON], of_team[:, WEIGHTED] = derivatives.of_team[:, WEIGHTED], derivatives.common

        def parts(array: Array) -> tuple[Array, Array]:
            return array[..., :6, :].take(used[0], axis=-1), array[..., 6:, :].take(used[1], axis=-1)

        right = Factor.of(parts(derivatives.of_team), parts(derivatives.own))
        own = parts(body.weight[:, None, :, None] * derivatives.own)
        return MotionFactors(derivatives, right, parts(of_team), own, used)

    def left(self, grams: Grams) -> Factor:
        """Return the left factor."""
        moments = [gram[entries[:, None], entries] for gram, entries in zip(grams, self.used, strict=True)]
        team, own = (
            [
                (part.reshape(-1, len(gram)) @ gram).reshape(part.shape)
                for part, gram in zip(parts, moments, strict=True)
            ]
            for parts in (self.team, self.own)
        )
        return Factor.of(team, own)


def wrench_evidence(
    body: BodyModel,
    derivatives: WrenchDerivatives,
    moments: WrenchMoments,
    noise: Array | None = None,
) -> Evidence:
    """Evidence of the total wrench on all unknowns; internal forces show the poses as well.

    Derivatives and moments are those at the state of ``body``, which has a load; ``noise`` as in ``motion_evidence``.
    """
    clean = without_noise(body, moments)
    left, right = wrench_factors(body, derivatives, clean)
    # Of equal unknowns, the product of the second parts is the transpose of that of the first ones.
    information = Factor((2.0 * left.team[0],), left.own).times(Factor(right.team[:1], right.own))
    of_robots = slice(0, body.count * body.unknowns.own)
    information[of_robots, of_robots] += between_robots(derivatives, derivatives, clean)
    if noise is None:
        left, right = noise_factors(body, derivatives, moments.number)
        noise = _symmetric(left.times(right))
    information = _symmetric(information)
    return Evidence.of_rows(wrench_score(derivatives, clean), information, noise, moments.number)


class Derivatives:
    """Derivatives at one state with a load, each computed when it is first needed.

    Args:
        body: Matrices at the state.
    """

    def __init__(self, body: BodyModel) -> None:
        self.body = body

    @cached_property
    def motion(self) -> MotionFactors:
        """Of motion sensors."""
        return MotionFactors.at(self.body)

    @cached_property
    def wrench(self) -> WrenchDerivatives:
        """Of the total wrench."""
        return WrenchDerivatives.at(self.body, self.motion.derivatives)


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


def wrench_factors(body: BodyModel, derivatives: WrenchDerivatives, moments: WrenchMoments) -> tuple[Factor, Factor]:
    """Left and right factor of the information of the total wrench, by clean moments.

    It is ``tr(D^T D G)`` with derivatives ``D`` by ``u`` and ``psi`` together; here without ``u_i u_j^T``, i != j.
    """
    used, local, (count, own, _, size) = body.without_velocity, derivatives.local, derivatives.local.shape
    common, by_robot = derivatives.common.take(used, axis=-1), local.reshape(count, own * 6, size)
    crossed = 0.5 * (common @ moments.of_motion[used[:, None], used])
    by_own = by_robot @ moments.with_motion[:, used].reshape(count, size, -1)
    crossed[: count * own] += by_own.reshape(count * own, 6, -1)
    of_wrenches = moments.of_wrenches.reshape(count, size, count, size)[range(count), :, range(count)]
    by_wrenches = (by_robot @ of_wrenches).reshape(local.shape)
    return Factor.of([crossed, common], [by_wrenches]), Factor.of([common, crossed], [local])


def information_on_theta(derivatives: Derivatives, moments: WrenchMoments) -> Array:
    """Information of the total wrench between all unknowns and theta, shape (u, 10), without that on all of them."""
    body, by = derivatives.body, derivatives.wrench
    clean, (count, own, _, size) = without_noise(body, moments), by.local.shape
    by_theta = by.common[body.unknowns.theta]
    by_common = by.common.reshape(len(by.common), -1) @ (by_theta @ clean.of_motion).reshape(len(by_theta), -1).T
    with_theta = (clean.with_motion @ by_theta.reshape(-1, body.features).T).reshape(count, size, -1, 6)
    flat = with_theta.transpose(0, 3, 1, 2).reshape(count, 6 * size, -1)
    by_common[: count * own] += (by.local.reshape(count, own, -1) @ flat).reshape(count * own, -1)
    return by_common


def between_robots(left: WrenchDerivatives, right: WrenchDerivatives, moments: WrenchMoments) -> Array:
    """Information between own unknowns of different robots, shape (N k, N k'): ``tr(local_k G_ij local_l^T)``."""
    (count, own, _, size), others = left.local.shape, right.local.shape[1]
    of_wrenches = moments.of_wrenches.reshape(count, size, count, size).copy()
    of_wrenches[range(count), :, range(count)] = 0.0
    by_gram = left.local.reshape(count, own * 6, size) @ of_wrenches.reshape(count, size, -1)
    by_other = by_gram.reshape(count * own, 6, count, size).transpose(2, 0, 1, 3)  # robot j, unknown k, 6, w
    blocks = by_other.reshape(count, -1, 6 * size) @ right.local.reshape(count, others, -1).swapaxes(1, 2)
    return blocks.transpose(1, 0, 2).reshape(count * own, -1)


def noise_factors(body: BodyModel, derivatives: WrenchDerivatives, number: float) -> tuple[Factor, Factor]:
    """Left and right factor of what noise of motion and wrenches adds to the information of ``number`` rows."""
    used, local, (count, own, _, size) = body.without_velocity, derivatives.local, derivatives.local.shape
    common = derivatives.common.take(used, axis=-1)
    by_noise = common @ (number * body.motion_noise[used[:, None], used])
    by_own = local.reshape(count, own * 6, size) @ (number * body.wrench_covariance)
    return Factor.of([by_noise], [by_own.reshape(local.shape)]), Factor.of([common], [local])


def information_table(weight: Array) -> Array:
    """Return the map (169, 256) from Gram matrices of ``motion[FORCING]`` to the load's information, for the
    information ``weight`` (6, 6) of the residual of the total wrench in one row.
    """
    size = len(REGRESSOR)
    flat = REGRESSOR.transpose(1, 0, 2).reshape(6, -1)
    table = (flat.T @ weight @ flat).reshape(size, LOAD_SIZE, size, LOAD_SIZE)
    return np.ascontiguousarray(table.transpose(0, 2, 1, 3)).reshape(size * size, -1)

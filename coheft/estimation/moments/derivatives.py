"""Derivatives of residuals by all unknowns, linear in the motion ``psi`` and in each robot's own wrench ``u_i``.

    d r_i  = -(own_i + predict_i[products] common) psi          residuals of motion sensors of robot i
    d rho  = local_i u_i + (M C found - L[products] common) psi   residual of the total wrench

``own`` is by a robot's own pose and sensor errors; ``common`` is the derivative of the products of ``w``, to which all
robots contribute, by any unknown. ``M`` is the spatial inertia, ``C`` the covariance of the fused ``(a, alpha)``, and
``found`` the change of the right side of its normal equations. Errors of sensors act on what a robot should read, not
on what it reads: these regressors are as free of noise as the fused motion. With the covariance ``P`` of the unknowns,
predictions are uncertain by

    cov(r_i) = J P J^T,    J = W_i^1/2 (D_i - B_i C found) psi,    D_i = own_i + predict_i[products] common
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.linear_algebra import inverse as inverse_of
from coheft.estimation.moments import rows
from coheft.estimation.moments.body import (
    FORCING,
    PRODUCTS,
    PRODUCTS_BY_RATE,
    PRODUCTS_BY_TURN,
    REGRESSOR,
    BodyModel,
    W,
    load_operator,
    residual_covariance,
)
from coheft.estimation.moments.rows import KINEMATICS_SIZE, ROW_SIZE, WRENCH_SIZE
from coheft.estimation.moments.unknowns import POSE_SIZE, THETA, Indices
from coheft.estimation.rigid_body.regressor import spatial_inertia

FOUND_TWIST, FOUND, COMMON, WEIGHTED = (slice(first, first + 6) for first in range(0, 24, 6))
"""Rows of ``MotionDerivatives.of_team``."""
_FORCING_PRODUCTS = slice(7, 13)
"""Slice of the products within ``motion[FORCING]``."""


@dataclass(frozen=True, eq=False)
class MotionDerivatives:
    """Derivatives by m unknowns: k own ones of each robot, one robot after another, then common ones.

    Attributes:
        own: Derivatives of predictions of ``(w, v, a, slope)``, shape (N, k, 12, features).
        of_team: What all robots contribute to, six rows each, shape (m, 24, features): ``sum_i B_i^T W_i`` times
            derivatives of predictions of twists; the same of ``(a, slope)``; derivatives of the products; and
            ``sum_i P_i^T W_i`` times derivatives of ``(a, slope)``, with half of what the products add to these, where
            ``P_i`` are the columns of ``predict_i`` for the products.
    """

    own: Array
    of_team: Array

    @property
    def found(self) -> Array:
        """Change of the right side of the normal equations of ``(a, alpha)``, shape (m, 6, features)."""
        return self.of_team[:, FOUND]

    @property
    def common(self) -> Array:
        """Derivatives of the products, shape (m, 6, features)."""
        return self.of_team[:, COMMON]

    @staticmethod
    def at(body: BodyModel) -> MotionDerivatives:
        """Compute those by the unknowns of the motion at the state of ``body``; common is the gyros' offset."""
        unknowns, count = body.unknowns, body.count
        own = np.zeros((count, unknowns.own, KINEMATICS_SIZE, body.features))
        own[:, :POSE_SIZE] = body.prediction_derivatives()
        common = np.zeros((unknowns.motion_size, 6, body.features))
        by_robot = common[: unknowns.gyros.start].reshape(count, unknowns.own, 6, -1)
        by_robot[:, :3, :, PRODUCTS] = body.shares[:, None, None, None] * PRODUCTS_BY_TURN
        if unknowns.errors.count:
            own[:, POSE_SIZE:], by_robot[:, POSE_SIZE:] = _by_errors(body, unknowns.errors.generators)
        common[unknowns.gyros, :, W] = -PRODUCTS_BY_RATE
        return MotionDerivatives._of(body, own, common)

    @staticmethod
    def by_errors(body: BodyModel, generators: Array) -> MotionDerivatives:
        """Compute those by sensor errors with these generators (k, width, width), which need not be declared."""
        own, common = _by_errors(body, generators)
        return MotionDerivatives._of(body, own, common.reshape(-1, 6, body.features))

    def by_poses(self, poses: Indices) -> MotionDerivatives:
        """Only those by poses, whose indices (N, 6) among all unknowns these are."""
        return MotionDerivatives(self.own[:, :POSE_SIZE], self.of_team[poses.ravel()])

    @staticmethod
    def _of(body: BodyModel, own: Array, common: Array) -> MotionDerivatives:
        fusion, by_products = body.accelerations, body.predict[:, rows.ACCELERATIONS, PRODUCTS]
        weighted = (fusion.weight[:, :, None] * by_products).swapaxes(1, 2)
        by_common, by_own = np.zeros((24, 6)), np.zeros((body.count, 1, 24, KINEMATICS_SIZE))
        by_common[FOUND] = (fusion.weighted.swapaxes(1, 2) @ by_products).sum(axis=0)
        by_common[COMMON], by_common[WEIGHTED] = np.eye(6), 0.5 * (weighted @ by_products).sum(axis=0)
        by_own[:, 0, FOUND_TWIST, rows.TWIST] = body.twist.weighted.swapaxes(1, 2)
        by_own[:, 0, FOUND, rows.ACCELERATIONS] = fusion.weighted.swapaxes(1, 2)
        by_own[:, 0, WEIGHTED, rows.ACCELERATIONS] = weighted
        of_team = by_common @ common
        of_team[: own.shape[0] * own.shape[1]] += (by_own @ own).reshape(-1, 24, body.features)
        return MotionDerivatives(own, of_team)


def _by_errors(body: BodyModel, generators: Array) -> tuple[Array, Array]:
    """Derivatives by sensor errors: of predictions (N, q, 12, features), and of products (N, q, 6, features)."""
    count, features, (number, width, _) = body.count, body.features, generators.shape
    calibrated = body.predicted_rows()

    def generated(part: slice) -> Array:
        flat = generators[:, part].reshape(-1, width)
        return (flat @ calibrated).reshape(count, number, -1, features)

    fused = body.fusion_map[PRODUCTS, :-1].reshape(6, count, ROW_SIZE)[:, :, rows.PRODUCTS].swapaxes(0, 1)
    return -generated(rows.KINEMATICS), fused[:, None] @ generated(rows.PRODUCTS)


@dataclass(frozen=True, eq=False)
class WrenchDerivatives:
    """The residual of the total wrench and its derivatives, multiplied by the root of its weight.

    Attributes:
        of_wrenches: The residual by all robots' wrenches, shape (6, w N).
        of_motion: The residual by ``psi``, shape (6, features).
        local: Derivatives by k own unknowns of each robot, linear in its wrench, shape (N, k, 6, w).
        common: Derivatives by all unknowns, linear in ``psi``, shape (u, 6, features).
    """

    of_wrenches: Array
    of_motion: Array
    local: Array
    common: Array

    @staticmethod
    def at(body: BodyModel, motion: MotionDerivatives) -> WrenchDerivatives:
        """Compute those by all unknowns at the state of ``body``, which has a load; ``motion`` are those of motions."""
        root, unknowns, size = whitening(body), body.unknowns, len(body.unknowns.errors.wrench)
        local = np.zeros((body.count, unknowns.own, 6, size))
        local[:, :POSE_SIZE, :, :WRENCH_SIZE] = body.adjoint_derivatives()
        if unknowns.errors.count:
            local[:, POSE_SIZE:] = _wrenches_by_errors(body, unknowns.errors.generators)
        common = np.zeros((unknowns.size, 6, body.features))
        common[: unknowns.motion_size] = _forcing(body, motion, root)
        common[unknowns.load, :, FORCING] = -(root @ REGRESSOR).transpose(2, 1, 0)
        return WrenchDerivatives._of(body, root, local, common)

    @staticmethod
    def by_errors(body: BodyModel, motion: MotionDerivatives, generators: Array) -> WrenchDerivatives:
        """Compute those by sensor errors with these generators, by which ``motion`` are the derivatives."""
        root, local = whitening(body), _wrenches_by_errors(body, generators)
        return WrenchDerivatives._of(body, root, local, _forcing(body, motion, root))

    def by_poses(self, poses: Indices) -> WrenchDerivatives:
        """Only those by poses, whose indices (N, 6) among all unknowns these are."""
        return replace(self, local=self.local[:, :POSE_SIZE], common=self.common[poses.ravel()])

    @staticmethod
    def _of(body: BodyModel, root: Array, local: Array, common: Array) -> WrenchDerivatives:
        of_wrenches, of_motion = np.zeros((6, body.count, local.shape[3])), np.zeros((6, body.features))
        of_wrenches[:, :, :WRENCH_SIZE] = (root @ body.adjoints).swapaxes(0, 1)
        of_motion[:, FORCING] = -root @ load_operator(body.state.fitted_load)
        return WrenchDerivatives(of_wrenches.reshape(6, -1), of_motion, root @ local, common)


def whitening(body: BodyModel) -> Array:
    """Return the matrix (6, 6) that whitens the residual of the total wrench at a state with a load."""
    weight = inverse_of(residual_covariance(body, body.state.fitted_load))
    return np.asarray(np.linalg.cholesky(weight)).T.astype(np.float64)


def _wrenches_by_errors(body: BodyModel, generators: Array) -> Array:
    """Derivatives of each robot's wrench in the body frame by its sensor errors, shape (N, q, 6, w)."""
    return body.adjoints[:, None] @ generators[:, rows.WRENCH, body.unknowns.errors.wrench]


def _forcing(body: BodyModel, motion: MotionDerivatives, root: Array) -> Array:
    """Derivatives of the whitened residual, linear in ``psi``, by the unknowns of ``motion``."""
    load = body.state.fitted_load
    by_found = root @ spatial_inertia(load[THETA]) @ body.accelerations.covariance
    by_products: Array = (root @ load_operator(load)[:, _FORCING_PRODUCTS]) @ motion.common
    return by_found @ motion.found - by_products


def prediction_covariance(
    body: BodyModel, derivatives: MotionDerivatives, covariance: Array, robot: int, psi: Array, change: Array
) -> Array:
    """Covariance of a robot's residuals by errors of the unknowns, in units of the noise, shape (12, 12).

    The fused motion depends on the unknowns as well, which ``B_i C found`` accounts for. ``covariance`` (u, u) is that
    of all unknowns, ``psi`` the motion (features,) or its mean over some rows, and ``change`` the same less the mean
    of all rows, because mean residuals of twists are removed.
    """
    predict, own, of_team = body.predict[robot], derivatives.own[robot], derivatives.of_team
    by_unknowns = np.zeros((len(of_team), rows.KINEMATICS_SIZE))
    for part, motion in ((rows.TWIST, change), (rows.ACCELERATIONS, psi)):
        fusion = body.twist if part is rows.TWIST else body.accelerations
        found = of_team[:, FOUND_TWIST] if part is rows.TWIST else derivatives.found
        by_unknowns[:, part] = -(found @ motion) @ (predict[part, fusion.part] @ fusion.covariance).T
        by_unknowns[body.unknowns.of_robot(robot), part] += own[:, part] @ motion
    by_unknowns[:, rows.ACCELERATIONS] += (derivatives.common @ psi) @ predict[rows.ACCELERATIONS, PRODUCTS].T
    by_unknowns *= np.sqrt(body.weight[robot])
    return by_unknowns.T @ covariance[: len(of_team), : len(of_team)] @ by_unknowns

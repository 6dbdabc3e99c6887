"""Derivatives of residuals by all unknowns, linear in the motion ``psi`` and in each robot's own wrench ``u_i``.

    d r_i  = -(own_i + predict_i[products] common) psi          residuals of motion sensors of robot i
    d rho  = local_i u_i + (M C found - L[products] common) psi   residual of the total wrench

``own`` is by a robot's own pose and sensor errors; ``common`` is the derivative of the products of ``w``, to which all
robots contribute, by any unknown. ``M`` is the spatial inertia, ``C`` the covariance of the fused ``(a, alpha)``, and
``found`` the change of the right side of its normal equations. Errors of sensors act on what a robot should read, not
on what it reads: these regressors are as free of noise as the fused motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coheft.estimation.geometry.spatial import Array
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
)
from coheft.estimation.moments.rows import KINEMATICS_SIZE, ROW_SIZE, WRENCH_SIZE
from coheft.estimation.moments.unknowns import POSE_SIZE, THETA
from coheft.estimation.rigid_body.regressor import spatial_inertia

_FORCING_PRODUCTS = slice(7, 13)
"""Slice of the products within ``motion[FORCING]``."""


@dataclass(frozen=True, eq=False)
class MotionDerivatives:
    """Derivatives by the unknowns of the motion: all robots' own ones and the gyros' offset, m in number.

    Attributes:
        own: Derivatives of predictions of ``(w, v, a, slope)``, shape (N, own, 12, features).
        common: Derivatives of the products, shape (m, 6, features).
        found: ``sum_i B_i^T W_i`` times derivatives of predictions of ``(a, slope)``, shape (m, 6, features).
    """

    own: Array
    common: Array
    found: Array

    @staticmethod
    def at(body: BodyModel) -> MotionDerivatives:
        """Compute them at the state of ``body``."""
        unknowns, features, count = body.unknowns, body.features, body.count
        of_robots = count * unknowns.own
        own = np.zeros((count, unknowns.own, KINEMATICS_SIZE, features))
        own[:, :POSE_SIZE] = body.prediction_derivatives()
        common, found = np.zeros((2, unknowns.motion_size, 6, features))
        by_robot = common[:of_robots].reshape(count, unknowns.own, 6, features)
        by_robot[:, :3, :, PRODUCTS] = body.shares[:, None, None, None] * PRODUCTS_BY_TURN
        if unknowns.errors.count:
            own[:, POSE_SIZE:], by_robot[:, POSE_SIZE:] = _by_errors(body)
        common[unknowns.gyros, :, W] = -PRODUCTS_BY_RATE

        fusion = body.accelerations
        to_found = fusion.weighted.swapaxes(1, 2)
        found[:of_robots] = (to_found[:, None] @ own[:, :, rows.ACCELERATIONS]).reshape(of_robots, 6, features)
        found += (to_found @ body.predict[:, rows.ACCELERATIONS, PRODUCTS]).sum(axis=0) @ common
        return MotionDerivatives(own, common, found)


def _by_errors(body: BodyModel) -> tuple[Array, Array]:
    """Derivatives by sensor errors: of predictions (N, q, 12, features), and of products (N, q, 6, features)."""
    errors, count, features = body.unknowns.errors, body.count, body.features
    calibrated = body.predicted_rows()

    def generated(part: slice) -> Array:
        generators = errors.generators[:, part].reshape(-1, errors.width)
        result: Array = (generators @ calibrated).reshape(count, errors.count, -1, features)
        return result

    fused = body.fusion_map[PRODUCTS, :-1].reshape(6, count, ROW_SIZE)[:, :, rows.PRODUCTS].swapaxes(0, 1)
    return -generated(rows.KINEMATICS), fused[:, None] @ generated(rows.PRODUCTS)


@dataclass(frozen=True, eq=False)
class WrenchDerivatives:
    """The residual of the total wrench and its derivatives, multiplied by the root of its weight.

    Attributes:
        of_wrenches: The residual by all robots' wrenches, shape (6, w N).
        of_motion: The residual by ``psi``, shape (6, features).
        local: Derivatives by each robot's own unknowns, linear in its wrench, shape (N, own, 6, w).
        common: Derivatives by all unknowns, linear in ``psi``, shape (u, 6, features).
    """

    of_wrenches: Array
    of_motion: Array
    local: Array
    common: Array

    @staticmethod
    def at(body: BodyModel, motion: MotionDerivatives, root: Array) -> WrenchDerivatives:
        """Compute them at the state of ``body``, which has a load; ``root`` (6, 6) whitens the residual."""
        unknowns, count, features = body.unknowns, body.count, body.features
        size = WRENCH_SIZE * (1 + body.has_rates)
        local = np.zeros((count, unknowns.own, 6, size))
        local[:, :POSE_SIZE, :, :WRENCH_SIZE] = body.adjoint_derivatives()
        if unknowns.errors.count:
            by_errors = unknowns.errors.generators[:, rows.WRENCH, unknowns.errors.wrench]
            local[:, POSE_SIZE:] = body.adjoints[:, None] @ by_errors

        load = body.state.fitted_load
        operator = load_operator(load)
        common = np.zeros((unknowns.size, 6, features))
        of_motion = common[: unknowns.motion_size]
        of_motion[:] = (root @ spatial_inertia(load[THETA]) @ body.accelerations.covariance) @ motion.found
        of_motion -= (root @ operator[:, _FORCING_PRODUCTS]) @ motion.common
        common[unknowns.load, :, FORCING] = -(root @ REGRESSOR).transpose(2, 1, 0)

        of_wrenches, by_motion = np.zeros((6, count, size)), np.zeros((6, features))
        of_wrenches[:, :, :WRENCH_SIZE] = (root @ body.adjoints).swapaxes(0, 1)
        by_motion[:, FORCING] = -root @ operator
        return WrenchDerivatives(of_wrenches.reshape(6, -1), by_motion, root @ local, common)

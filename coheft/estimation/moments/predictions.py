"""How uncertain predictions of motion sensors are, because poses and sensor errors are.

    cov(r_i) = J P J^T,    J = W_i^1/2 (D_i - B_i C found) psi,    D_i = own_i + predict_i[products] common

with the covariance ``P`` of the unknowns. The fused motion depends on them as well, which ``B_i C found`` accounts for.
"""

from __future__ import annotations

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments import rows
from coheft.estimation.moments.body import PRODUCTS, BodyModel
from coheft.estimation.moments.derivatives import FOUND_TWIST, MotionDerivatives


def prediction_covariance(
    body: BodyModel, derivatives: MotionDerivatives, covariance: Array, robot: int, psi: Array, change: Array
) -> Array:
    """Covariance of a robot's residuals by errors of the unknowns, in units of the noise, shape (12, 12).

    Args:
        body: Matrices at the estimate.
        derivatives: Derivatives there.
        covariance: Covariance of all unknowns, shape (u, u).
        robot: Index of the robot.
        psi: Motion, or the mean of some rows, shape (features,).
        change: The same less the mean of all rows, because mean residuals of twists are removed.
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
    result: Array = by_unknowns.T @ covariance[: len(of_team), : len(of_team)] @ by_unknowns
    return result

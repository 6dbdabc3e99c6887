"""Whether wrenches fit a load once those of one robot are read with another sign, in other units, or in other axes.

    sum_j Ad(g_j) u_j + Ad(g_i) D u_i = X(psi) theta + offset,    D = sum_k d_k D_k

is linear in theta, the offset and the ``d_k``, at poses that are known from the motion. ``1 + D`` takes what robot i
has read to what would fit.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from coheft.estimation.geometry.spatial import Array, rotation_log
from coheft.estimation.moments import rows
from coheft.estimation.moments.body import FORCING, REGRESSOR, BodyModel, residual_covariance
from coheft.estimation.moments.rows import ROW_SIZE
from coheft.estimation.moments.unknowns import THETA

_FORCES = np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
SCALE: Array = np.eye(6)[None]
"""The ``D_k`` of another sign or unit of wrenches, shape (1, 6, 6)."""
UNITS: Array = np.array([_FORCES, np.eye(6) - _FORCES])
"""Those of another sign or unit of forces, and of torques, shape (2, 6, 6)."""
AXES: Array = np.array([np.kron(np.eye(2), each.reshape(3, 3)) for each in np.eye(9)])
"""Those of other axes, shape (9, 6, 6)."""
_ALIKE = 0.2
"""Factors that differ by less are called alike, and a turn by less [rad] is not told beside another factor: sensors
within their tolerances make both.
"""
_ROUNDING = 1e-6


class Misreading(NamedTuple):
    """How the wrenches of one robot would have to be read.

    Attributes:
        robot: Index of the robot.
        factor: The matrix ``1 + D`` by which to multiply its wrenches ``(f, t)``, shape (6, 6).
        residuals: Those of the total wrench then, in standard deviations, shape (n, 1, 6).
        freedom: Their degrees of freedom.
    """

    robot: int
    factor: Array
    residuals: Array
    freedom: int

    @property
    def in_words(self) -> str:
        """What the factor means: the rest of a sentence whose subject is the wrenches."""
        force, torque = (float(np.cbrt(np.linalg.det(part))) for part in (self.factor[:3, :3], self.factor[3:, 3:]))
        left, _, right = np.linalg.svd(self.factor[:3, :3] / force)
        turn = rotation_log(left @ right)
        if (angle := float(np.linalg.norm(turn))) > (_ROUNDING if abs(force - 1.0) < _ALIKE else _ALIKE):
            x, y, z = np.round(turn / angle, 1) + 0.0  # no -0.0
            sign = "had the opposite sign and " if force < 0.0 else ""
            return f"{sign}were turned by {np.degrees(angle):.0f}° about ({x}, {y}, {z})"
        if abs(force - torque) > _ALIKE * abs(force):
            return f"had {force:.2g} times the forces and {torque:.2g} times the torques"
        return "had the opposite sign" if abs(force + 1.0) < _ALIKE else f"were {force:.2g} times as large"


def misreadings(body: BodyModel, extended_rows: Array, by: Array) -> Iterator[Misreading]:
    """Yield the likeliest misreading by each robot, if the load then has a mass above zero.

    Args:
        body: Matrices at a state whose poses do not depend on wrenches.
        extended_rows: Rows with one load, shape (n, X).
        by: The matrices ``D_k``: ``SCALE``, ``UNITS`` or ``AXES``.
    """
    count = len(extended_rows)
    of_load = np.einsum("nf,fal->nal", extended_rows @ body.motion_map[FORCING].T, REGRESSOR)
    total = extended_rows @ body.wrench_map.T
    own = extended_rows[:, : body.one].reshape(count, body.count, ROW_SIZE)[:, :, rows.WRENCH]
    for robot in range(body.count):
        read_otherwise = np.einsum("ab,kbc,nc->nak", body.adjoints[robot], by, own[:, robot])
        regressor = np.concatenate([of_load, -read_otherwise], axis=2)
        covariance = body.wrench_noise
        for _ in range(2):  # the noise of the motion counts as well, as soon as the load is known
            white = np.linalg.inv(np.linalg.cholesky(covariance))
            by_all, known = (white @ regressor).reshape(6 * count, -1), (total @ white.T).ravel()
            found, *_ = np.linalg.lstsq(by_all, known)
            covariance = residual_covariance(body, found[: -len(by)])
        if not found[THETA.start] > 0.0:
            continue
        residuals = (known - by_all @ found).reshape(count, 1, 6)
        factor = np.eye(6) + np.tensordot(found[-len(by) :], by, axes=1)
        yield Misreading(robot, factor, residuals, residuals.size - len(found))

"""Whether wrenches fit a load once they are tared, or those of one robot are read otherwise.

    sum_j Ad(g_j) u_j + Ad(g_i) D u_i = X(psi) theta + offset,    D = sum_k d_k D_k

is linear in theta, the offset and the ``d_k``, at poses that are known from the motion. ``1 + D`` takes what robot i
has read to what would fit: it has another sign, other units, or other axes.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from coheft.estimation.geometry.spatial import Array, rotation_log
from coheft.estimation.moments import rows
from coheft.estimation.moments.body import FORCING, REGRESSOR, BodyModel, residual_covariance
from coheft.estimation.moments.rows import ROW_SIZE
from coheft.estimation.moments.unknowns import OFFSET, THETA

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
_LEAST = 0.1
"""Misreadings change wrenches by at least this share; what changes them by less are errors of sensors."""
_SMALLEST = 1e-4
"""No unit makes readings larger by more than the inverse of this factor."""
_ROUNDING = 1e-6
_UNTARED = "with a constant offset: has a sensor not been tared?"
_THETA_SIZE = 10


class Misreading(NamedTuple):
    """What would make wrenches fit a load.

    Attributes:
        robot: Index of the robot whose wrenches would have to be read otherwise; None for an offset of their sum.
        words: How: the rest of a sentence after "wrenches fit no load, but would"; empty if it means nothing.
        residuals: Those of the total wrench then, in standard deviations, shape (n, 1, 6).
        freedom: Their degrees of freedom.
    """

    robot: int | None
    words: str
    residuals: Array
    freedom: int


class WrenchFit:
    """Fits of a load to the wrenches of extended rows with one load (n, X), at poses of ``body`` that do not depend on
    these.
    """

    def __init__(self, body: BodyModel, extended_rows: Array) -> None:
        self._body, self._count = body, len(extended_rows)
        self._of_load = np.einsum("nf,fal->nal", extended_rows @ body.motion_map[FORCING].T, REGRESSOR)
        self._total = extended_rows @ body.wrench_map.T
        each = extended_rows[:, : body.one].reshape(self._count, body.count, ROW_SIZE)
        self._own = each[:, :, rows.WRENCH]

    def as_read(self) -> Iterator[Misreading]:
        """Yield the fit of a load without an offset, if it has a mass above zero."""
        for _, _, residuals in self._fitted(np.zeros((self._count, 6, 0)), has_offset=False):
            yield Misreading(None, "", residuals, residuals.size - _THETA_SIZE)

    def untared(self) -> Iterator[Misreading]:
        """Yield that of a load and an offset."""
        for load, _, residuals in self._fitted(np.zeros((self._count, 6, 0))):
            yield Misreading(None, _UNTARED, residuals, residuals.size - len(load))

    def misreadings(self, by: Array) -> Iterator[Misreading]:
        """Yield the likeliest misreading by each robot, if the load then has a mass above zero; ``by`` are the matrices
        ``D_k``.
        """
        for robot in range(self._body.count):
            read_otherwise = np.einsum("ab,kbc,nc->nak", self._body.adjoints[robot], by, self._own[:, robot])
            for load, found, residuals in self._fitted(-read_otherwise):
                words = in_words(np.eye(6) + np.tensordot(found, by, axes=1))
                yield Misreading(robot, words, residuals, residuals.size - len(load) - len(found))

    def without(self, robot: int) -> Iterator[Misreading]:
        """Yield the fit of a load and an offset to the wrenches of all other robots."""
        own = self._own[:, robot] @ self._body.adjoints[robot].T
        for load, _, residuals in self._fitted(np.zeros((self._count, 6, 0)), self._total - own):
            yield Misreading(None, "", residuals, residuals.size - len(load))

    def _fitted(
        self, others: Array, total: Array | None = None, has_offset: bool = True
    ) -> Iterator[tuple[Array, Array, Array]]:
        """Fit offset and theta (16,), and the factors (k,) of other regressors (n, 6, k), to the total wrench (n, 6).

        Yield these and the residuals (n, 1, 6), in standard deviations; nothing if the mass is not above zero.
        """
        regressor = np.concatenate([self._of_load, others], axis=2)
        if not has_offset:
            regressor[:, :, OFFSET] = 0.0
        total = self._total if total is None else total
        size, covariance = self._of_load.shape[2], self._body.wrench_noise
        for _ in range(2):  # the noise of the motion counts as well, as soon as the load is known
            white = np.linalg.inv(np.linalg.cholesky(covariance))
            by_all, known = (white @ regressor).reshape(6 * self._count, -1), (total @ white.T).ravel()
            found, *_ = np.linalg.lstsq(by_all, known)
            covariance = residual_covariance(self._body, found[:size])
        if found[THETA.start] > 0.0:
            yield found[:size], found[size:], (known - by_all @ found).reshape(self._count, 1, 6)


def in_words(factor: Array) -> str:
    """Say what it means if wrenches ``(f, t)`` have to be multiplied by a factor (6, 6); "if those of r2" precedes.

    It is empty if the factor is nearly 1, or does more than scale, turn or mirror forces and torques.
    """
    parts = factor[:3, :3], factor[3:, 3:]
    sizes = np.linalg.svd(np.array(parts), compute_uv=False)  # the largest first
    is_plausible = (sizes[:, 2] > np.maximum(_SMALLEST, (1.0 - _ALIKE) * sizes[:, 0])).all()
    if not is_plausible or np.abs(factor - np.eye(6)).max() < _LEAST:
        return ""
    force, torque = (float(np.cbrt(np.linalg.det(part))) for part in parts)
    left, _, right = np.linalg.svd(parts[0] / force)
    turn = rotation_log(left @ right)
    if (angle := float(np.linalg.norm(turn))) > (_ROUNDING if abs(force - 1.0) < _ALIKE else _ALIKE):
        x, y, z = np.round(turn / angle, 1) + 0.0  # no -0.0
        sign = "had the opposite sign and " if force < 0.0 else ""
        return f"{sign}were turned by {np.degrees(angle):.0f}° about ({x}, {y}, {z})"
    if abs(force - torque) > _ALIKE * abs(force):
        changed = ((name, each) for name, each in (("forces", force), ("torques", torque)) if abs(each - 1.0) > _ALIKE)
        return "had " + " and ".join(f"{name} {_times(each)}" for name, each in changed)
    return "had the opposite sign" if abs(force + 1.0) < _ALIKE else f"were {_times(force)}"


def _times(factor: float) -> str:
    return "of the opposite sign" if abs(factor + 1.0) < _ALIKE else f"{factor:.3g} times as large"

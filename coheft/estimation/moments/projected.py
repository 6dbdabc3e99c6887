"""Moments for large teams: of extended rows with ``psi`` at one state, and of wrenches with each other.

    X * features + (6 N)^2 numbers instead of X^2,    psi(now) = (motion_map_then @ predicted_now)^-1 psi(then)

Rows obey ``T x = predicted @ psi`` up to their noise, so a constant matrix converts moments at one state to another
state, without the rows. It is close to the identity if poses were already known at the first state.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.linear_algebra import inverse as inverse_of
from coheft.estimation.moments import rows
from coheft.estimation.moments.body import MOTION_SIZE, PRODUCTS, PRODUCTS_BY_RATE, BodyModel, W
from coheft.estimation.moments.moments import Moments, wrench_indices
from coheft.estimation.moments.rows import ROW_SIZE
from coheft.estimation.moments.sensor_errors import MORE, ONE, RATES
from coheft.estimation.moments.unknowns import Indices
from coheft.estimation.rigid_body.mass_properties import pack_symmetric

_RATES = slice(MOTION_SIZE, 2 * MOTION_SIZE)


def motion_then_to_now(then: BodyModel, now: BodyModel) -> Array:
    """Return the matrix that takes ``psi`` at one state to ``psi`` at another, shape (features, features)."""
    predicted, gyros = now.predicted_rows(), now.state.gyros
    read = np.eye(now.features)  # rows contain the gyro offset
    read[W, 0] = gyros
    read[PRODUCTS, W] = np.tensordot(gyros, PRODUCTS_BY_RATE, axes=1)
    read[PRODUCTS, 0] = pack_symmetric(np.outer(gyros, gyros))
    if now.has_rates:
        read[_RATES, _RATES] = read[:MOTION_SIZE, :MOTION_SIZE]
        read[_RATES, MOTION_SIZE] = 0.0
    parts = [rows.TWIST, rows.PRODUCTS]
    if now.has_rates:
        parts += [slice(RATES + part.start, RATES + part.stop) for part in parts]
    for part in parts:
        predicted[:, part] = predicted[:, part] @ read
    if now.state.calibration is not None:
        predicted = inverse_of(now.state.calibration) @ predicted
    extended = [predicted[:, part].reshape(-1, now.features) for part in (slice(ROW_SIZE), slice(MORE, None))]
    found = then.motion_map @ np.concatenate([extended[0], predicted[:1, ONE], extended[1]])
    if now.has_rates:
        found[MOTION_SIZE, MOTION_SIZE] = 1.0  # the rate of the constant, which is always 0
    return inverse_of(found)


@dataclass(frozen=True, eq=False)
class ProjectedMoments:
    """Moments projected at the state of ``body``.

    Attributes:
        body: The matrices at that state.
        crossed: ``sum x psi^T``, shape (X, features).
        wrenches: ``sum u u^T``, shape (w N, w N).
    """

    body: BodyModel
    crossed: Array
    wrenches: Array

    @staticmethod
    def of(extended_rows: Array, body: BodyModel) -> ProjectedMoments:
        """Compute moments of extended rows (n, X), projected at a state."""
        wrenches = extended_rows[:, wrench_indices(body.count, body.unknowns.errors)]
        return ProjectedMoments(body, extended_rows.T @ (extended_rows @ body.motion_map.T), wrenches.T @ wrenches)

    @staticmethod
    def at(body: BodyModel, moments: Moments) -> ProjectedMoments:
        """Project moments at a state; those that are projected at another state are converted."""
        wrenches = moments.of_wrenches(wrench_indices(body.count, body.unknowns.errors))
        return ProjectedMoments(body, moments.with_motion(body), wrenches)

    def with_motion(self, body: BodyModel) -> Array:
        """See ``Moments``."""
        if body is self.body:
            return self.crossed
        result: Array = self.crossed @ motion_then_to_now(self.body, body).T
        return result

    def of_wrenches(self, indices: Indices) -> Array:
        """See ``Moments``."""
        return self.wrenches

    def sums(self, one: int) -> Array:
        """See ``Moments``."""
        result: Array = self.crossed[:, 0]
        return result

    def __add__(self, other: ProjectedMoments) -> ProjectedMoments:
        return ProjectedMoments(self.body, self.crossed + other.crossed, self.wrenches + other.wrenches)

    def __sub__(self, other: ProjectedMoments) -> ProjectedMoments:
        return ProjectedMoments(self.body, self.crossed - other.crossed, self.wrenches - other.wrenches)

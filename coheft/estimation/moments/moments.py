"""Second moments of rows, which are exact at every state.

    G = sum x x^T,    at a state:  sum psi psi^T = E G E^T,    sum x psi^T = G E^T,    E = motion_map

``G`` does not depend on poses, so nothing has to be summed again when their estimates improve. ``RowMoments`` keeps all
of ``G``. ``ProjectedMoments``, for large teams, keep ``X * features + (6 N)^2`` numbers instead of ``X^2``: moments of
extended rows with ``psi`` at one state, and of wrenches with each other. Rows obey ``T x = predicted @ psi`` up to
their noise, so a constant matrix converts these to another state, without the rows:

    psi(now) = (motion_map_then @ predicted_now)^-1 psi(then)

It is close to the identity if poses were already known at the first state.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.linear_algebra import inverse as inverse_of
from coheft.estimation.moments import rows
from coheft.estimation.moments.body import FORCING, FORCING_SIZE, MOTION_SIZE, PRODUCTS, PRODUCTS_BY_RATE, BodyModel, W
from coheft.estimation.moments.rows import ROW_SIZE, WRENCH
from coheft.estimation.moments.sensor_errors import MORE, ONE, RATES, SensorErrors
from coheft.estimation.moments.unknowns import Indices
from coheft.estimation.rigid_body.mass_properties import pack_symmetric


class Moments(Protocol):
    """The second moments of the team's extended rows that likelihoods need."""

    def with_motion(self, body: BodyModel) -> Array:
        """Compute ``sum x psi^T`` at a state, shape (X, features)."""
        ...

    def of_wrenches(self, indices: Indices) -> Array:
        """``sum u u^T`` of all robots' wrenches and their rates, at these indices of a row, shape (w N, w N)."""
        ...

    def sums(self, one: int) -> Array:
        """``sum x``, shape (X,); ``one`` is the index of the constant 1, so that entry is the number of rows."""
        ...

    def __add__(self, other: Self) -> Self: ...

    def __sub__(self, other: Self) -> Self: ...


@dataclass(frozen=True, eq=False)
class RowMoments:
    """``G`` itself, shape (X, X)."""

    matrix: Array

    @staticmethod
    def of(extended_rows: Array) -> RowMoments:
        """Compute moments of extended rows, shape (n, X)."""
        return RowMoments(extended_rows.T @ extended_rows)

    def with_motion(self, body: BodyModel) -> Array:
        """See ``Moments``."""
        return self.matrix @ body.motion_map.T

    def of_wrenches(self, indices: Indices) -> Array:
        """See ``Moments``."""
        return self.matrix[indices[:, None], indices]

    def sums(self, one: int) -> Array:
        """See ``Moments``."""
        result: Array = self.matrix[one]
        return result

    def __add__(self, other: RowMoments) -> RowMoments:
        return RowMoments(self.matrix + other.matrix)

    def __sub__(self, other: RowMoments) -> RowMoments:
        return RowMoments(self.matrix - other.matrix)


def robot_indices(count: int, errors: SensorErrors) -> Indices:
    """Places of each robot's row, and of what follows it, in extended rows of so many, shape (N, 24 + more)."""
    robots = np.arange(count)[:, None]
    more = ROW_SIZE * count + 1 + errors.more * robots + np.arange(errors.more)
    return np.hstack([ROW_SIZE * robots + np.arange(ROW_SIZE), more])


def wrench_indices(count: int, errors: SensorErrors) -> Indices:
    """Indices of all robots' wrenches in a row, each followed by its rates if there are any, shape (w N,)."""
    own = np.arange(WRENCH.start, WRENCH.stop)
    own = np.concatenate([own, ROW_SIZE + own]) if errors.has_rates else own
    indices: Indices = robot_indices(count, errors)[:, own].ravel()
    return indices


@dataclass(frozen=True, eq=False)
class MotionMoments:
    """Moments of the readings of motion sensors, calibrated at a state.

    Attributes:
        with_motion: ``sum (w, v, a, slope)_i psi^T``, shape (N, 12, features).
        of_motion: ``sum psi psi^T``, shape (features, features); its first entry is the number of rows.
    """

    with_motion: Array
    of_motion: Array

    @property
    def number(self) -> float:
        """Number of rows."""
        return float(self.of_motion[0, 0])


@dataclass(frozen=True, eq=False)
class WrenchMoments:
    """Moments of the readings of force and torque sensors, calibrated at a state.

    Attributes:
        of_wrenches: ``sum u u^T`` of all robots' wrenches (w = 6, or 12 with their rates), shape (w N, w N).
        with_motion: ``sum u psi^T``, shape (w N, features).
        of_motion: ``sum psi psi^T`` of the same rows, shape (features, features).
    """

    of_wrenches: Array
    with_motion: Array
    of_motion: Array

    @property
    def number(self) -> float:
        """Number of rows."""
        return float(self.of_motion[0, 0])


@dataclass(frozen=True, eq=False)
class EvaluatedMoments:
    """Moments at a state: of the motion in all rows, and of the wrench in the rows with the present load."""

    motion: MotionMoments
    wrench: WrenchMoments


def evaluated_moments(body: BodyModel, of_all: Moments, of_load: Moments) -> EvaluatedMoments:
    """Compute moments at a state from those of all rows and of the rows with the present load."""
    crossed = of_all.with_motion(body)
    motion = MotionMoments(body.calibrated(crossed), body.motion_map @ crossed)
    if of_load is of_all:
        return EvaluatedMoments(motion, _wrench_moments(body, of_load, crossed, motion.of_motion))
    return EvaluatedMoments(motion, wrench_moments(body, of_load))


def wrench_moments(body: BodyModel, moments: Moments) -> WrenchMoments:
    """Compute moments of wrenches at a state."""
    crossed = moments.with_motion(body)
    return _wrench_moments(body, moments, crossed, body.motion_map @ crossed)


def view_moments(body: BodyModel, moments: Moments) -> Array:
    """Compute ``sum v v^T`` of views ``v = (motion[FORCING], total wrench)`` at a state, shape (19, 19)."""
    crossed, indices = moments.with_motion(body), wrench_indices(body.count, body.unknowns.errors)
    of_forcing, wrench = crossed[:, FORCING], body.wrench_map[:, indices]
    one, size = body.one, FORCING_SIZE
    result = np.zeros((size + 6, size + 6))
    result[:size, :size] = body.motion_map[FORCING] @ of_forcing
    result[size:, :size] = body.wrench_map @ of_forcing
    result[:size, size:] = result[size:, :size].T
    constant = body.wrench_map[:, one]
    across = np.outer(wrench @ of_forcing[indices, 0], constant)
    square = wrench @ moments.of_wrenches(indices) @ wrench.T
    result[size:, size:] = square + across + across.T + crossed[one, 0] * np.outer(constant, constant)
    return result


def _wrench_moments(body: BodyModel, moments: Moments, crossed: Array, of_motion: Array) -> WrenchMoments:
    indices, count = wrench_indices(body.count, body.unknowns.errors), body.count
    with_motion, of_wrenches = crossed[indices], moments.of_wrenches(indices)
    if body.state.calibration is None:
        return WrenchMoments(of_wrenches, with_motion, of_motion)
    own = body.unknowns.errors.wrench
    turn, constant = body.state.calibration[:, own[:, None], own], body.state.calibration[:, own, ONE].ravel()
    size = len(own)

    def calibrated(left: Array) -> Array:
        return (turn @ left.reshape(count, size, -1)).reshape(count * size, -1)

    of_wrenches = calibrated(calibrated(of_wrenches).T)
    sums, with_motion = calibrated(with_motion[:, :1]).ravel(), calibrated(with_motion)
    if constant.any():
        across = np.outer(constant, sums)
        of_wrenches = of_wrenches + across + across.T + crossed[body.one, 0] * np.outer(constant, constant)
        with_motion = with_motion + np.outer(constant, crossed[body.one])
    return WrenchMoments(of_wrenches, with_motion, of_motion)


def motion_then_to_now(then: BodyModel, now: BodyModel) -> Array:
    """Return the matrix that takes ``psi`` at one state to ``psi`` at another, shape (features, features)."""
    predicted, gyros = now.predicted_rows(), now.state.gyros
    read = np.eye(now.features)  # rows contain the gyro offset
    read[W, 0] = gyros
    read[PRODUCTS, W] = np.tensordot(gyros, PRODUCTS_BY_RATE, axes=1)
    read[PRODUCTS, 0] = pack_symmetric(np.outer(gyros, gyros))
    parts = [rows.TWIST, rows.PRODUCTS]
    if now.has_rates:
        rates = slice(MOTION_SIZE, 2 * MOTION_SIZE)
        read[rates, rates] = read[:MOTION_SIZE, :MOTION_SIZE]
        read[rates, MOTION_SIZE] = 0.0
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
    """Moments projected at the state of ``body``: ``crossed`` are ``sum x psi^T``, shape (X, features), and
    ``wrenches`` are ``sum u u^T``, shape (w N, w N).
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
        return self.crossed @ motion_then_to_now(self.body, body).T

    def of_wrenches(self, indices: Indices) -> Array:
        """See ``Moments``."""
        return self.wrenches

    def sums(self, one: int) -> Array:
        """See ``Moments``."""
        return self.crossed[:, 0]

    def __add__(self, other: ProjectedMoments) -> ProjectedMoments:
        return ProjectedMoments(self.body, self.crossed + other.crossed, self.wrenches + other.wrenches)

    def __sub__(self, other: ProjectedMoments) -> ProjectedMoments:
        return ProjectedMoments(self.body, self.crossed - other.crossed, self.wrenches - other.wrenches)

"""Constant errors of a robot's sensors, as a linear map from readings to true values.

    true row = T x,    x = (row, 1, rates of the row, flexing),    T <- exp(sum_k eta_k E_k) T

Every generator ``E_k`` has a few entries ``(to, from, factor)``, see ``_generators``. ``eta`` corrects readings: the
error of the sensor is ``-eta``, its delay ``+eta``.

Constant errors of gyros, forces and torques are not among ``eta``. Only their sums over the team matter, and these are
unknowns of the team. Constant errors of velocities do not matter at all, because means of twists are removed.

An error that is not declared is zero: it costs nothing and is not estimated. ``Corrections`` tells how rates of late
sensors and the flexing of grasps correct rows, and the variances of the noise after that.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from coheft.estimation.geometry.spatial import CROSS_OF_AXES, Array
from coheft.estimation.moments import rows
from coheft.estimation.moments.rows import FLEXING_SIZE, PRODUCTS, ROW_SIZE, SLOPE, WRENCH, A, RowNoise, V, W
from coheft.estimation.tolerance import SENSORS, SHAPES, SensorDrift, SensorTolerance

ONE, RATES = ROW_SIZE, ROW_SIZE + 1
"""Indices of the constant and of the rates in an extended row."""
MORE = RATES
"""Place of all that follows the constant in an extended row: rates if there are any, then flexing if there is any."""
_FIRST = dict(zip(SENSORS, (0, 3, 6, 12, 15), strict=True))
_PLACE_OF_PRODUCT = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]]) + PRODUCTS.start

KINDS = (
    "acceleration_bias",
    *(f"{sensor}_{what}" for what in SHAPES for sensor in _FIRST),
    "velocity_place",
    "acceleration_place",
    "clock",
    "wrench_delay",
    "grasp_compliance",
)
"""Kinds of errors: a bias [m/s²]; a gain of all axes and a scale of each, relative; a small rotation of the mount
[rad]; cross-talk, relative; places [m]; delays [s]; a compliance, negative [m/N]."""

DELAYS = ("clock", "wrench_delay")
"""Kinds of delays: of all sensors of a robot, or of its force and torque alone."""

Entry = tuple[int, int, float]


class SensorErrors:
    """Which constant errors are declared. All robots have the same parameters; one that is exact stays zero.

    Args:
        tolerances: Standard deviation of each kind that is declared; a kind that is missing or 0 is exact. Of each
            robot of the team, or of all of them if they are alike.
        other_kinds: Kinds that have parameters although none of these robots declares them.

    Raises:
        ValueError: A kind is not known.

    Attributes:
        tolerances: As given.
        names: Kind of each parameter.
        deviations: Prior standard deviation of each parameter, 0 if it is exact, shape (N, q), or (1, q) if all robots
            are alike.
        has_rates: Whether any error is a delay, so that rows are followed by their rates.
        is_flexing: Whether grasps are compliant, so that rows are followed by rates of the force, see ``flexing``.
        width: Length of an extended row of one robot.
        more: Number of entries that follow the constant.
        wrench: Indices of the wrench in an extended row, then of its rates if there are any, shape (6,) or (12,).
        flexing: Slice of the rates of the force in an extended row; empty if grasps are stiff.
        generators: ``E_k``, shape (q, width, width).
    """

    def __init__(self, *tolerances: Mapping[str, float], other_kinds: Iterable[str] = ()) -> None:
        declared = {kind for each in tolerances for kind, size in each.items() if size}.union(other_kinds)
        unknown = sorted(declared.union(*tolerances) - set(KINDS))
        if unknown:
            raise ValueError(f"errors of kind {unknown[0]!r} are not known; there are {', '.join(KINDS)}")
        kinds = [kind for kind in KINDS if kind in declared]
        self.tolerances = tolerances
        self.has_rates = any(kind in kinds for kind in DELAYS)
        self.is_flexing = "grasp_compliance" in kinds
        self.more = ROW_SIZE * self.has_rates + FLEXING_SIZE * self.is_flexing
        self.width = MORE + self.more
        wrench = np.arange(WRENCH.start, WRENCH.stop)
        self.wrench = np.concatenate([wrench, RATES + wrench]) if self.has_rates else wrench
        self.flexing = slice(self.width - FLEXING_SIZE * self.is_flexing, self.width)
        generators = [(kind, entries) for kind in kinds for entries in self._generators(kind)]
        self.names = tuple(kind for kind, _ in generators)
        self.deviations = np.array([[each.get(kind, 0.0) for kind in self.names] for each in tolerances])
        if "clock" in kinds:  # clocks count from the anchor's, so the difference of two of them is what is unknown
            clock = self.names.index("clock")
            self.deviations[:, clock] = np.hypot(self.deviations[:, clock], self.deviations[:, clock].max(initial=0.0))
        self.generators = np.zeros((len(generators), self.width, self.width))
        for matrix, (_, entries) in zip(self.generators, generators, strict=True):
            for to, source, factor in entries:
                matrix[to, source] += factor
                if self.has_rates and source < ROW_SIZE:
                    matrix[RATES + to, RATES + source] += factor

    @staticmethod
    def of(team: Sequence[SensorTolerance], drift: SensorDrift, others: Iterable[SensorTolerance] = ()) -> SensorErrors:
        """Errors of the data sheets of a team's robots; what ``others`` declare has parameters as well."""
        alike = team[:1] if len(set(team)) == 1 else team
        declared = [kind for tolerance in others for kind, size in _kinds(tolerance, drift).items() if size]
        return SensorErrors(*(_kinds(tolerance, drift) for tolerance in alike), other_kinds=declared)

    def scaled(self, factors: Mapping[str, float]) -> SensorErrors:
        """Return the same parameters with tolerances that are larger by a factor for each kind."""
        tolerances = ({kind: factors.get(kind, 1.0) * size for kind, size in each.items()} for each in self.tolerances)
        return SensorErrors(*tolerances, other_kinds=self.names)

    def are(self, *kinds: str) -> npt.NDArray[np.bool_]:
        """Whether each parameter is of one of these kinds, shape (q,)."""
        return np.array([name in kinds for name in self.names], dtype=bool)

    @property
    def count(self) -> int:
        """Number of parameters of one robot, ``q``."""
        return len(self.names)

    @property
    def row_size(self) -> int:
        """Length of one robot's row with what follows it, without the constant."""
        return self.width - 1

    def _generators(self, kind: str) -> list[list[Entry]]:
        """Entries of each parameter of a kind."""
        match kind:
            case "acceleration_bias":
                return [[(A.start + axis, ONE, 1.0)] for axis in range(3)]
            case "clock" | "wrench_delay":
                delayed = range(ROW_SIZE) if kind == "clock" else range(WRENCH.start, WRENCH.stop)
                return [[(index, RATES + index, 1.0) for index in delayed]]
            case "velocity_place" | "acceleration_place":
                of_axis = _velocity_at if kind == "velocity_place" else _acceleration_at
                return [of_axis(axis) for axis in range(3)]
            case "grasp_compliance":
                flexed = [*range(V.start, V.stop), *range(A.start, A.stop)]
                return [[(index, self.flexing.start + k, 1.0) for k, index in enumerate(flexed)]]
        sensor, _, shape = kind.partition("_")
        return [_of_matrix(_FIRST[sensor], matrix) for matrix in SHAPES[shape]]

    def step(self, eta: Array) -> Array:
        """Compute ``exp(sum_k eta_k E_k)`` of each robot to third order: (N, q) to (N, width, width)."""
        total = np.tensordot(eta, self.generators, axes=1)
        square = total @ total
        return np.eye(self.width) + total + 0.5 * square + square @ total / 6.0


def _kinds(tolerance: SensorTolerance, drift: SensorDrift) -> dict[str, float]:
    """Standard deviation of each kind in a data sheet; a sensor that drifts has an offset even if it tells of none."""
    kinds = {f"{sensor}_{shape}": tolerance.of(sensor, shape) for shape in SHAPES for sensor in SENSORS}
    return kinds | {
        "acceleration_bias": max(tolerance.acceleration_offset, drift.acceleration),
        "velocity_place": tolerance.velocity_place,
        "acceleration_place": tolerance.acceleration_place,
        "clock": tolerance.clock,
        "wrench_delay": tolerance.wrench_delay,
        "grasp_compliance": tolerance.grasp_compliance,
    }


def _velocity_at(axis: int) -> list[Entry]:
    """``w x r`` for the unit vector ``r`` along an axis."""
    return [(V.start + to, W.start + of, float(CROSS_OF_AXES[of, to, axis])) for to, of in _others(axis)]


def _acceleration_at(axis: int) -> list[Entry]:
    """``alpha x r + w x (w x r)``, which is ``alpha x r + w w_axis - r |w|^2``."""
    turning = [(A.start + to, SLOPE.start + of, float(CROSS_OF_AXES[of, to, axis])) for to, of in _others(axis)]
    towards = [(A.start + to, int(_PLACE_OF_PRODUCT[to, axis]), 1.0) for to, _ in _others(axis)]
    away = [(A.start + axis, int(_PLACE_OF_PRODUCT[of, of]), -1.0) for of, _ in _others(axis)]
    return turning + towards + away


def _others(axis: int) -> list[tuple[int, int]]:
    """The two other axes, each with the one that is left."""
    one, other = (axis + 1) % 3, (axis + 2) % 3
    return [(one, other), (other, one)]


def _of_matrix(first: int, matrix: Array) -> list[Entry]:
    """``y += matrix @ y`` for the sensor whose three numbers begin at ``first``."""
    entries: list[Entry] = []
    for to, source in np.argwhere(matrix).tolist():
        factor = float(matrix[to, source])
        entries.append((first + to, first + source, factor))
        if first == _FIRST["gyro"]:  # its slope and its products are of the same sensor
            entries.append((SLOPE.start + to, SLOPE.start + source, factor))
            entries += [
                (
                    int(_PLACE_OF_PRODUCT[to, axis]),
                    int(_PLACE_OF_PRODUCT[source, axis]),
                    factor * (2.0 if to == axis else 1.0),
                )
                for axis in range(3)
            ]
    return entries


@dataclass(frozen=True, eq=False)
class Corrections:
    """The corrections of all robots' rows at one state, whose ``calibration`` takes extended rows to calibrated ones.

    Methods take ``rows.KINEMATICS`` or ``rows.WRENCH``, k numbers of a row.
    """

    noise: RowNoise
    errors: SensorErrors
    calibration: Array | None
    count: int

    def variance(self, part: slice) -> Array:
        """Variance of a part of all rows as corrected, shape (N, k); infinite where there is no sensor."""
        deviations = self._deviations(part)
        variance: Array = np.broadcast_to(deviations**2.0, (self.count, deviations.shape[1]))
        if self.errors.has_rates:
            variance = variance + (np.square(self.by_rates(part)) @ self.variance_of_rates(part)[..., None])[..., 0]
        if self.errors.is_flexing and self.calibration is not None:
            by_flexing = np.square(self.by_flexing(part)) @ self.variance_of_flexing()[..., None]
            variance = variance + by_flexing[..., 0]
        return variance

    def variance_of_rates(self, part: slice) -> Array:
        """Variance of the rates of a part of all rows, shape (N, k)."""
        deviations = self._deviations(part)
        variance = np.where(np.isfinite(deviations), deviations, 0.0) ** 2.0 * self.noise.rates[:, part] ** 2.0
        return np.broadcast_to(variance, (self.count, variance.shape[1]))

    def variance_of_flexing(self) -> Array:
        """Effective noise variance of each robot's flexing, shape (N, 6)."""
        force = np.where(np.isfinite(self.noise.wrench), self.noise.wrench, 0.0)[:, [0, 1, 2, 0, 1, 2]]
        return np.broadcast_to(force**2.0 * self.noise.flexing**2.0, (self.count, FLEXING_SIZE))

    def by_rates(self, part: slice) -> Array:
        """Correction of a part of each row by its rates, shape (N, k, k); there must be rates."""
        assert self.calibration is not None
        return self.calibration[:, part, RATES + part.start : RATES + part.stop]

    def by_flexing(self, part: slice) -> Array:
        """Correction of a part of each row by the robot's flexing, shape (N, k, 6)."""
        assert self.calibration is not None
        return self.calibration[:, part, self.errors.flexing]

    def _deviations(self, part: slice) -> Array:
        return self.noise.wrench if part == rows.WRENCH else self.noise.kinematics

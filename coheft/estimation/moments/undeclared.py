"""Score tests for sensor errors whose tolerance is zero: would rows fit better if the error were an unknown?

    s = S_k - I_ko H^-1 S_o,    V = its variance,    s^T V^-1 s ~ chi-square

``o`` are the unknowns of the fit, ``k`` the three parameters of one kind of error of one robot. The part that the fit's
unknowns explain is projected out, so an error that looks like another pose or another load cannot be detected. Of gyros
and of torques only the sum of all offsets shows; offsets of forces differ by their lever arms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from coheft.estimation.chi_square import chi_square_threshold
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.body import BodyModel
from coheft.estimation.moments.chapter import Chapter, evidence_of
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.sensor_errors import DELAYS, SensorErrors
from coheft.estimation.moments.unknowns import Flags, Indices, State, Unknowns
from coheft.estimation.tolerance import SENSORS

KINDS_OF_ONE_ROBOT = (
    "acceleration_bias",
    *(f"{sensor}_mounting" for sensor in ("gyro", "velocity", "acceleration")),
    *(f"{sensor}_scale" for sensor in SENSORS),
    "velocity_place",
    "acceleration_place",
)
"""Kinds of errors of one robot that can be tested; offsets of gyros, forces and torques are tested in any case."""
_LEAST_SHARE = 1e-3
"""Least share of an error's information that has to remain beside all unknowns; less may be linearisation error."""
_LATE = 0.002
"""Sensors that are later than others by more seem to have other errors as well, by the square of the delay [s]."""


class UndeclaredError(NamedTuple):
    """A sensor error with tolerance zero, and how much the rows show it.

    Attributes:
        robot: Index of the robot, None if it may be any.
        kind: One of ``KINDS``, or ``gyro_bias``, ``force_bias`` or ``torque_bias``.
        size: Statistic over its threshold.
    """

    robot: int | None
    kind: str
    size: float


def undeclared_error(
    estimate: Estimate,
    chapter: Chapter,
    settings: FitSettings,
    anchor: int,
    kinds: Sequence[str],
    false_alarm: float,
) -> UndeclaredError | None:
    """Return the most significant sensor error with tolerance zero, None if no tolerance is zero, or if poses, load
    or declared errors are not all seen.

    Args:
        estimate: The fit to all rows of the chapter.
        chapter: Rows and prior.
        settings: Settings of the fit.
        anchor: Index of the robot whose pose stays fixed.
        kinds: Kinds of errors to test beside offsets, some of ``KINDS_OF_ONE_ROBOT``.
        false_alarm: False-alarm probability for one robot and one kind of error.
    """
    declared, unknowns = settings.errors, estimate.body.unknowns
    if (np.abs(estimate.state.eta[:, declared.are(*DELAYS)]) > _LATE).any():
        kinds = ()
    errors, body = declared, estimate.body
    if kinds:
        errors = _errors_of((*kinds, *declared.names))
        body = replace(settings, errors=errors).body(_with_errors(estimate.state, errors))
    # From here on, unknowns are those of the fit (at ``others``) and all errors to test (at ``tested``).
    own = np.flatnonzero(errors.are(*declared.names))
    is_tested = np.tile(errors.are(*kinds), (body.count, 1))
    is_tested[:, own] &= unknowns.deviations == 0.0
    tests, others = _Tests.of(body, settings, is_tested), _places(body.unknowns, own)

    rows = evidence_of(body, chapter.evaluation()(body))
    before = chapter.prior_evidence(estimate.body)
    fitted = rows.restricted(others) + before
    free = settings.free(unknowns, anchor, with_load=True)
    solution = fitted.restricted(free).solve(settings.limits(unknowns.count, estimate.guess)[free])
    if solution.hidden.any():
        return None
    tested = tests.indices
    gain = rows.information[np.ix_(tested, others[free])] @ solution.inverse
    score = rows.score[tested] - gain @ fitted.score[free]

    spread, square = rows.information + rows.noise, np.ix_(free, free)
    across = gain @ spread[np.ix_(others[free], tested)]
    variance = spread[np.ix_(tested, tested)] - across - across.T
    of_fit = (spread[np.ix_(others, others)] + before.information + before.noise)[square]
    variance += gain @ of_fit @ gain.T
    alone = rows.information[np.ix_(tested, tested)]
    sizes = _surprises(tests.vectors(score), tests.matrices(variance), tests.matrices(alone), false_alarm)
    if not len(sizes):
        return None
    largest = int(sizes.argmax())
    return UndeclaredError(*tests.errors[largest], float(sizes[largest]))


class _Tests(NamedTuple):
    """The errors with tolerance zero that are tested, three parameters each.

    Attributes:
        errors: Robot and kind of each.
        indices: Indices of all parameters, those of the offset of the total wrench last if it is tested.
        directions: That offset per unit of the parameters of each of the last errors, shape (f, 6, 3), or (0, 0, 3).
    """

    errors: list[tuple[int | None, str]]
    indices: Indices
    directions: Array

    @staticmethod
    def of(body: BodyModel, settings: FitSettings, is_tested: Flags) -> _Tests:
        """Of these sensor errors, shape (N, q), and of the offsets that are not declared; ``body`` has all of them."""
        unknowns, every = body.unknowns, np.arange(body.unknowns.size)
        names = unknowns.errors.names
        errors: list[tuple[int | None, str]] = [(robot, names[k]) for robot, k in np.argwhere(is_tested)[::3].tolist()]
        indices, directions = [unknowns.eta[is_tested]], np.zeros((0, 0, 3))
        if not settings.has_gyro_offset:
            errors.append((None, "gyro_bias"))
            indices.append(every[unknowns.gyros])
        if not settings.has_offset:
            errors += [*((robot, "force_bias") for robot in range(body.count)), (None, "torque_bias")]
            indices.append(every[unknowns.offset])
            directions = np.concatenate([body.adjoints[:, :, :3], np.eye(6)[None, :, 3:]])
        return _Tests(errors, np.concatenate(indices), directions)

    @property
    def _own(self) -> int:
        """Number of parameters that are unknowns themselves."""
        return 3 * (len(self.errors) - len(self.directions))

    def vectors(self, of_all: Array) -> Array:
        """Return the part of a vector (k,) for each error, shape (b, 3)."""
        return np.concatenate([of_all[: self._own].reshape(-1, 3), of_all[self._own :] @ self.directions])

    def matrices(self, of_all: Array) -> Array:
        """Return the part of a matrix (k, k) for each error, shape (b, 3, 3)."""
        own, count = self._own, self._own // 3
        blocks = of_all[:own, :own].reshape(count, 3, count, 3)[range(count), :, range(count)]
        of_sums = self.directions.swapaxes(1, 2) @ of_all[own:, own:] @ self.directions
        return np.concatenate([blocks, of_sums])


def _surprises(score: Array, variance: Array, alone: Array, false_alarm: float) -> Array:
    """Return chi-squares (b,) of scores (b, 3) over their thresholds, in directions with enough information left."""
    root = np.sqrt(np.maximum(np.diagonal(alone, axis1=1, axis2=2), 1e-300))
    shares, directions = np.linalg.eigh(variance / (root[:, :, None] * root[:, None]))
    along = np.square(((score / root)[:, None] @ directions)[:, 0])
    is_seen = shares > _LEAST_SHARE
    squares = np.where(is_seen, along / np.where(is_seen, shares, 1.0), 0.0).sum(axis=1)
    thresholds = np.array([np.inf, *(chi_square_threshold(freedom, false_alarm) for freedom in (1, 2, 3))])
    result: Array = squares / thresholds[is_seen.sum(axis=1)]
    return result


@lru_cache(maxsize=8)
def _errors_of(kinds: tuple[str, ...]) -> SensorErrors:
    """Return errors of these kinds, of all robots."""
    return SensorErrors(dict.fromkeys(kinds, 1.0))


def _with_errors(state: State, errors: SensorErrors) -> State:
    """Return the state with more sensor errors among its unknowns, all of them zero."""
    eta = np.zeros((len(state.poses), errors.count))
    calibration = errors.step(eta) if state.calibration is None else state.calibration
    return State(state.poses, eta, calibration, state.gyros, state.load)


def _places(many: Unknowns, own: Indices) -> Indices:
    """Indices of a fit's unknowns, with its sensor errors ``own``, among those with more of them."""
    by_robot = np.hstack([many.poses, many.eta[:, own]])
    return np.concatenate([by_robot.ravel(), np.arange(many.gyros.start, many.size)])

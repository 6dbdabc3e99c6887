"""Score tests for sensor errors whose tolerance is zero: would rows fit better if the error were an unknown?

    s = S_k - I_ko H^-1 S_o,    V = its variance,    s^T V^-1 s ~ chi-square

``o`` are the unknowns of the fit, ``k`` the parameters of one kind of error of one robot. The part that the fit's
unknowns explain is projected out, so an error that looks like another pose or another load cannot be detected.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from coheft.estimation.chi_square import chi_square_threshold
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.chapter import Chapter, evidence_of
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.fit_settings import FitSettings, Guess
from coheft.estimation.moments.sensor_errors import SensorErrors
from coheft.estimation.moments.unknowns import Indices, State, Unknowns
from coheft.estimation.tolerance import SENSORS

_TESTED = (
    "acceleration_bias",
    *(f"{sensor}_mounting" for sensor in ("gyro", "velocity", "acceleration")),
    *(f"{sensor}_scale" for sensor in SENSORS),
    "velocity_place",
    "acceleration_place",
)
_LEAST_SHARE = 1e-3
"""Least share of an error's information that has to remain beside all unknowns; less may be linearisation error."""


class UndeclaredError(NamedTuple):
    """A sensor error with tolerance zero, and how much the rows show it.

    Attributes:
        robot: Index of the robot.
        kind: One of ``KINDS``.
        size: Statistic over its threshold.
    """

    robot: int
    kind: str
    size: float


def undeclared_error(
    estimate: Estimate, guess: Guess, chapter: Chapter, settings: FitSettings, anchor: int, false_alarm: float
) -> UndeclaredError | None:
    """Return the most significant sensor error with tolerance zero, None if no tolerance is zero, or if poses, load
    or declared errors are not all seen.

    Args:
        estimate: The fit to all rows of the chapter.
        guess: Guess of theta.
        chapter: Rows and prior.
        settings: Settings of the fit.
        anchor: Index of the robot whose pose stays fixed.
        false_alarm: False-alarm probability for one robot and one kind of error.
    """
    declared, unknowns = settings.errors, estimate.body.unknowns
    is_declared = unknowns.deviations > 0.0
    names_declared = [{name for name, has_it in zip(declared.names, own, strict=True) if has_it} for own in is_declared]
    errors = SensorErrors(dict.fromkeys((*_TESTED, *declared.names), 1.0))
    body = replace(settings, errors=errors).body(_with_errors(estimate.state, errors))
    every, own = body.unknowns, np.flatnonzero([name in declared.names for name in errors.names])
    is_tested = np.array([[name in _TESTED and name not in known for name in errors.names] for known in names_declared])
    others = _places(every, own)

    rows = evidence_of(body, chapter.evaluation()(body))
    before = chapter.prior_evidence(estimate.body)
    fitted = rows.restricted(others) + before
    free = settings.free(unknowns, anchor, with_load=True)
    solution = fitted.restricted(free).solve(settings.limits(unknowns.count, guess)[free])
    if solution.hidden.any():
        return None
    inverse = solution.inverse
    tested = every.eta[is_tested]
    gain = rows.information[np.ix_(tested, others[free])] @ inverse
    score = rows.score[tested] - gain @ fitted.score[free]

    spread, square = rows.information + rows.noise, np.ix_(free, free)
    across = gain @ spread[np.ix_(others[free], tested)]
    variance = spread[np.ix_(tested, tested)] - across - across.T
    of_fit = (spread[np.ix_(others, others)] + before.information + before.noise)[square]
    variance += gain @ of_fit @ gain.T
    alone = rows.information[np.ix_(tested, tested)]
    sizes = _surprises(score, _blocks(variance), _blocks(alone), false_alarm)
    if not len(sizes):
        return None
    largest = int(sizes.argmax())
    robot, parameter = np.argwhere(is_tested)[3 * largest].tolist()
    return UndeclaredError(robot, errors.names[parameter], float(sizes[largest]))


def _blocks(matrix: Array) -> Array:
    """Blocks (b, 3, 3) on the diagonal of a matrix (3 b, 3 b): each kind of error of a robot has three parameters."""
    count = len(matrix) // 3
    blocks: Array = matrix.reshape(count, 3, count, 3)[range(count), :, range(count)]
    return blocks


def _surprises(score: Array, variance: Array, alone: Array, false_alarm: float) -> Array:
    """Return chi-squares (b,) of scores (3 b,) over their thresholds, in directions with enough information left."""
    root = np.sqrt(np.maximum(np.diagonal(alone, axis1=1, axis2=2), 1e-300))
    shares, directions = np.linalg.eigh(variance / (root[:, :, None] * root[:, None]))
    along = np.square(((score.reshape(-1, 3) / root)[:, None] @ directions)[:, 0])
    is_seen = shares > _LEAST_SHARE
    squares = np.where(is_seen, along / np.where(is_seen, shares, 1.0), 0.0).sum(axis=1)
    thresholds = np.array([np.inf, *(chi_square_threshold(freedom, false_alarm) for freedom in (1, 2, 3))])
    result: Array = squares / thresholds[is_seen.sum(axis=1)]
    return result


def _with_errors(state: State, errors: SensorErrors) -> State:
    """Return the state with more sensor errors among its unknowns, all of them zero."""
    eta = np.zeros((len(state.poses), errors.count))
    calibration = errors.step(eta) if state.calibration is None else state.calibration
    return State(state.poses, eta, calibration, state.gyros, state.load)


def _places(many: Unknowns, own: Indices) -> Indices:
    """Indices of a fit's unknowns, with its sensor errors ``own``, among those with more of them."""
    by_robot = np.hstack([many.poses, many.eta[:, own]])
    return np.concatenate([by_robot.ravel(), np.arange(many.gyros.start, many.size)])

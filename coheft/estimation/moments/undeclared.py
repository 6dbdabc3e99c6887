"""Score tests for sensor errors whose tolerance is zero: would rows fit better if the error were an unknown?

    s = S_k - I_ko H^-1 S_o,    V = its variance,    s^T V^-1 s ~ chi-square

``o`` are the unknowns of the fit, ``k`` the three parameters of one kind of error of one robot. The part that the fit's
unknowns explain is projected out, so an error that looks like another pose or another load cannot be detected. Of gyros
and of torques only the sum of all offsets shows; offsets of forces differ by their lever arms. Delays show by how much
the readings change from row to row, see ``late_sensor``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import chain
from typing import NamedTuple

import numpy as np

from coheft.estimation.chi_square import chi_square_threshold
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.beside_fit import BesideFit
from coheft.estimation.moments.body import BodyModel
from coheft.estimation.moments.chapter import Chapter, EvidenceAt
from coheft.estimation.moments.derivatives import MotionDerivatives, WrenchDerivatives
from coheft.estimation.moments.evidence import Evidence
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.likelihood import Derivatives
from coheft.estimation.moments.moments import EvaluatedMoments
from coheft.estimation.moments.rows import KINEMATICS, ROW_SIZE, TWIST, WRENCH
from coheft.estimation.moments.sensor_errors import DELAYS, KINDS, SensorErrors
from coheft.estimation.moments.unknowns import Flags, Indices
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
    """A sensor error with tolerance zero, and how much the rows show it: ``size`` is its statistic over the threshold,
    ``kind`` one of ``KINDS``, or ``gyro_bias``, ``force_bias`` or ``torque_bias``; any robot may have it if ``robot``
    is None.
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
    declared, body = settings.errors, estimate.body
    if (np.abs(estimate.state.eta[:, declared.are(*DELAYS)]) > _LATE).any():
        kinds = ()
    kinds = [kind for kind in kinds if _are_exact(body, kind).any()]
    if not kinds and settings.has_gyro_offset and settings.has_offset:
        return None
    moments, before = chapter.evaluation()(body), chapter.prior_evidence(body)
    rows, free = EvidenceAt(estimate.derivatives).of(moments), settings.free(body.unknowns, anchor, with_load=True)
    fitted = (rows + before).restricted(free)
    solution = fitted.solve(settings.limits(body.unknowns.count, estimate.guess)[free])
    if solution.hidden.any():
        return None
    parts = [_Tests.of_robots(estimate.derivatives, kinds, moments)] if kinds else []
    if not settings.has_gyro_offset:
        parts.append(_Tests.of_common([(None, "gyro_bias")], rows, body.unknowns.gyros, np.eye(3)[None]))
    if not settings.has_offset:
        errors = [*((robot, "force_bias") for robot in range(body.count)), (None, "torque_bias")]
        by_errors = np.concatenate([body.adjoints[:, :, :3], np.eye(6)[None, :, 3:]])
        parts.append(_Tests.of_common(errors, rows, body.unknowns.offset, by_errors))
    tests = _Tests.together(parts)
    of_fit = (rows.information + rows.noise + before.information + before.noise)[np.ix_(free, free)]
    gain = tests.information[:, :, free] @ solution.inverse
    score = tests.score - gain @ fitted.score
    across = gain @ (tests.information + tests.noise)[:, :, free].swapaxes(1, 2)
    variance = tests.own_information + tests.own_noise - across - across.swapaxes(1, 2)
    variance += (gain.reshape(-1, len(free)) @ of_fit).reshape(gain.shape) @ gain.swapaxes(1, 2)
    sizes = _surprises(score, variance, tests.own_information, false_alarm)
    largest = int(sizes.argmax())
    return UndeclaredError(*tests.errors[largest], float(sizes[largest]))


class _Tests(NamedTuple):
    """The evidence of rows on b errors with tolerance zero, which have three parameters each.

    Attributes:
        errors: Robot and kind of each.
        score: Shape (b, 3).
        information: With the u unknowns of the fit, shape (b, 3, u).
        noise: What the regressors' noise adds to it.
        own_information, own_noise: The same of an error's own parameters, shape (b, 3, 3).
    """

    errors: Sequence[tuple[int | None, str]]
    score: Array
    information: Array
    noise: Array
    own_information: Array
    own_noise: Array

    @staticmethod
    def of_robots(of_fit: Derivatives, kinds: Sequence[str], moments: EvaluatedMoments) -> _Tests:
        """Evidence on errors of these kinds of those robots that do not declare them."""
        body = of_fit.body
        errors = _errors_of((*kinds, *body.unknowns.errors.names))
        generators, names = errors.generators[errors.are(*kinds)], [name for name in KINDS if name in kinds]
        every = [(robot, name) for robot in range(body.count) for name in names]
        chosen = np.flatnonzero(np.transpose([_are_exact(body, name) for name in names]))

        motion = MotionDerivatives.by_errors(body, generators)
        wrench = WrenchDerivatives.by_errors(body, motion, generators)
        tested = BesideFit(of_fit, motion, wrench, 3)
        score, information, own_information = tested.evidence(moments)
        noise, own_noise = tested.noise(moments.motion.number, moments.wrench.number)
        size = body.unknowns.size
        of_all = score.reshape(-1, 3), information.reshape(-1, 3, size), noise.reshape(-1, 3, size)
        return _Tests([every[k] for k in chosen], *(each[chosen] for each in (*of_all, own_information, own_noise)))

    @staticmethod
    def of_common(errors: Sequence[tuple[int | None, str]], rows: Evidence, part: slice, directions: Array) -> _Tests:
        """Evidence on errors that change common unknowns of the fit, by ``directions`` (b, k, 3) times parameters."""
        by_error = directions.swapaxes(1, 2)
        matrices = (rows.information[part], rows.noise[part])
        own = (by_error @ each[:, part] @ directions for each in matrices)
        return _Tests(errors, by_error @ rows.score[part], *(by_error @ each for each in matrices), *own)

    @staticmethod
    def together(parts: Sequence[_Tests]) -> _Tests:
        """All of some tests."""
        errors, *arrays = zip(*parts, strict=True)
        return _Tests(list(chain(*errors)), *map(np.concatenate, arrays))


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


def _are_exact(body: BodyModel, kind: str) -> Flags:
    """Whether each robot declares no error of this kind, shape (N,)."""
    deviations: Array = body.unknowns.deviations[:, body.unknowns.errors.are(kind)]
    return np.asarray((deviations == 0.0).all(axis=1))


@lru_cache(maxsize=8)
def _errors_of(kinds: tuple[str, ...]) -> SensorErrors:
    """Return errors of these kinds, of all robots."""
    return SensorErrors(dict.fromkeys(kinds, 1.0))


def late_sensor(
    body: BodyModel,
    rows: Array,
    numbers: Indices,
    residuals: Callable[[Array], tuple[Array, Array]],
    by_wrench: Array,
    period: float,
    false_alarm: float,
) -> UndeclaredError | None:
    """Return the most significant delay with tolerance zero, None if all are declared or there are too few rows.

        s = sum_n d_n . r_n,    s^2 / sum_n |d_n|^2 ~ chi-square at most

    ``r_n`` are the residuals of a row, ``d_n`` their derivative by the delay of one robot's sensors. A reading changes
    per second as between the rows before and after, so the noise of ``d_n`` is independent of that of ``r_n``; where
    residuals are corrected by rates, from samples of these two rows, the rows beside them are taken. What the fit's
    unknowns explain of a delay is not projected out: rarely much, and the test only becomes less sensitive.

    Args:
        body: Matrices at the fit.
        rows: Extended rows of the present load, shape (n, X).
        numbers: Their numbers, shape (n,).
        residuals: Gives those of rows, whitened: of the total wrench (n, 1, 6), and of motion sensors (n, N, 12).
        by_wrench: Takes extended rows to the whitened residual of the total wrench, shape (6, X).
        period: Duration of a row [s].
        false_alarm: False-alarm probability for one delay.
    """
    errors, deviations, far = body.unknowns.errors, body.unknowns.deviations, 2 if body.has_rates else 1
    is_tested = np.array([(deviations[:, errors.are(kind)] == 0.0).all(axis=1) for kind in DELAYS])  # shape (2, N)
    between = numbers[2 * far :] - numbers[: -2 * far] == 2 * far
    if not is_tested.any() or not between.any():
        return None
    count, size = body.count, body.one
    change = (rows[2 * far :, :size] - rows[: -2 * far, :size])[between]
    change = change.reshape(-1, count, ROW_SIZE) / (2.0 * far * period)
    wrench, motion = residuals(rows[far:-far][between])

    own = change[:, :, KINEMATICS]
    if body.state.calibration is not None:
        own = (body.state.calibration[:, KINEMATICS, :ROW_SIZE] @ change.transpose(1, 2, 0)).transpose(2, 0, 1)
    of_motion = np.sqrt(body.weight) * own
    of_motion[:, :, TWIST] -= of_motion[:, :, TWIST].mean(axis=0)  # as means of twists are removed
    by_robot = by_wrench[:, :size].reshape(6, count, ROW_SIZE).transpose(1, 2, 0)
    of_clock = (change.transpose(1, 0, 2) @ by_robot).transpose(1, 0, 2)
    of_delay = (change[:, :, WRENCH].transpose(1, 0, 2) @ by_robot[:, WRENCH]).transpose(1, 0, 2)

    by_motion = np.array([(of_motion * motion).sum(axis=(0, 2)), np.zeros(count)])
    score = by_motion + [(each * wrench).sum(axis=(0, 2)) for each in (of_clock, of_delay)]
    variance = np.array([np.square(of_motion).sum(axis=(0, 2)), np.zeros(count)])
    variance += [np.square(each).sum(axis=(0, 2)) for each in (of_clock, of_delay)]
    sizes = np.where(is_tested, score**2 / np.maximum(variance, 1e-300), 0.0) / chi_square_threshold(1, false_alarm)
    kind, robot = np.unravel_index(int(sizes.argmax()), sizes.shape)
    is_clear = count > 2 or DELAYS[kind] != "clock"  # two clocks differ, but which of them is off?
    return UndeclaredError(int(robot) if is_clear else None, DELAYS[kind], float(sizes[kind, robot]))

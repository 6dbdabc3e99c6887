"""The results of a study, in the struct that becomes its JSON report."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain

import msgspec
import numpy as np

from coheft.app.results.errors import MOST_STDS, in_stds
from coheft.app.results.quantities import ALL_TEN, QUANTITIES, Errors, Quantity, TeamArrays
from coheft.app.study.detection import Detection, judge_detection
from coheft.app.study.statistics import Interval, normalised_square, ratio_of_roots, root_mean
from coheft.app.study.trial import Moments, Outcome, Trial
from coheft.estimation.geometry.spatial import Array

Number = float | None
"""A number; None if there were no estimates to compute it from."""


class Consistency(msgspec.Struct, frozen=True, kw_only=True):
    """Normalized error squared per degree of freedom, of one robot per run.

    Attributes:
        nees: The value: 1 if the stated covariance is right.
        nees_low: Lower end of the interval that contains it in 95 of 100 studies if the covariance is right.
        nees_high: Upper end.
    """

    nees: Number
    nees_low: Number
    nees_high: Number


class Recovered(Consistency, frozen=True, kw_only=True):
    """Accuracy of the estimates of one quantity, in SI units, over all robots or edges of all runs.

    Attributes:
        rms: Root mean square error; for vectors and matrices, of the (Frobenius) norm.
        bound_full: Cramér-Rao bound of ``rms`` with all sensors; after a load change, of an estimator that knows its
            time.
        ratio_full: ``rms / bound_full``; over several times or noises, of errors that are scaled by their bounds.
        ratio_full_low: Lower end of its 95 % sampling interval, over runs.
        ratio_full_high: Upper end.
        missing: Number of estimates without a value, in all runs; they are left out above.
    """

    rms: Number
    bound_full: Number
    ratio_full: Number
    ratio_full_low: Number
    ratio_full_high: Number
    missing: int


class Accuracy(Recovered, frozen=True, kw_only=True):
    """Accuracy also compared with a second bound.

    Attributes:
        bound_two_step: Bound with poses from kinematics alone, and inertia from all sensors given those poses.
        ratio_two_step: ``rms / bound_two_step``, computed as ``ratio_full``.
    """

    bound_two_step: Number
    ratio_two_step: Number


class Cells(msgspec.Struct, frozen=True):
    """Number of NEES, each of one quantity at one time and noise, and of those outside their intervals."""

    count: int
    outside_95: int
    outside_9999: int


class Recovery(msgspec.Struct, frozen=True):
    """Accuracy some time after the load has changed [s]: of its mass, centre of mass and inertia."""

    seconds_after: float
    mass: Recovered
    com: Recovered
    inertia: Recovered


class Claimed(msgspec.Struct, frozen=True):
    """Number of estimates with an error that their own standard deviations rule out.

    Attributes:
        count: Number of estimates of payloads and poses, of all runs at all times.
        contradicted: Number of them with an error above four of their own standard deviations.
        most_stds: The largest error of all, in its own standard deviations; None if there are no estimates.
        valid_numbers: Number of numbers in valid estimates, of all robots, runs and noises, ten times a second.
        beyond_five: How many of them are off by more than five of their own standard deviations, which none should be;
            off the truth of the block to which the estimate belongs.
    """

    count: int
    contradicted: int
    most_stds: Number
    valid_numbers: int
    beyond_five: int


class EstimatorResult(msgspec.Struct, frozen=True):
    """Results of one estimator. Poses are those of the neighbours' grasp frames in the robot's own.

    ``converged`` is the share of robots that had converged.
    """

    pose_rotation: Accuracy
    pose_translation: Accuracy
    mass: Accuracy
    com: Accuracy
    inertia: Accuracy
    all_ten: Consistency
    converged: float
    cells: Cells
    claimed: Claimed
    detection: Detection
    recovery: Recovery | None
    impossible_payloads: int


class Cell(msgspec.Struct, frozen=True):
    """Results at one noise and one time, by estimator."""

    noise_scale: float
    at_s: float
    results: dict[str, EstimatorResult]


class StudyReport(msgspec.Struct, frozen=True):
    """The report of a study.

    Attributes:
        seeds: First and last seed.
        at_s: Times at which accuracy was evaluated [s].
        units: Units of ``rms`` and bounds.
        results: Results for all of these times and noises together, by estimator.
    """

    scenario: str
    seeds: tuple[int, int]
    runs: int
    at_s: list[float]
    noise_scales: list[float]
    units: dict[str, str]
    results: dict[str, EstimatorResult]
    cells: list[Cell]


@dataclass(frozen=True, eq=False)
class _Judged:
    """Errors of one run of one estimator at one time, with bounds."""

    seed: int
    errors: Errors
    full: TeamArrays
    two_step: TeamArrays | None = None


def summarise(groups: Sequence[Sequence[Trial]], moments: Moments, times: Sequence[int]) -> dict[str, EstimatorResult]:
    """Compute results by estimator, of some of the moments; the runs at each noise differ in their seed only."""
    return {name: _estimator_result(name, groups, moments, times) for name in groups[0][0].outcomes}


def _estimator_result(
    name: str, groups: Sequence[Sequence[Trial]], moments: Moments, times: Sequence[int]
) -> EstimatorResult:
    outcomes = [trial.outcomes[name] for group in groups for trial in group]
    cells = [
        [_Judged(trial.seed, trial.outcomes[name].errors[k], trial.full[k], trial.two_step[k]) for trial in group]
        for group in groups
        for k in times
    ]
    return EstimatorResult(
        **{quantity.name: _accuracy(quantity, cells) for quantity in QUANTITIES},
        all_ten=Consistency(**_named("nees", _nees(ALL_TEN, cells))),
        converged=float(np.mean([outcome.converged[k] for outcome in outcomes for k in times])),
        cells=_cells([*QUANTITIES, ALL_TEN], cells),
        claimed=_claimed([one.errors for one in chain.from_iterable(cells)], outcomes),
        detection=judge_detection([outcome.notices for outcome in outcomes], moments.change, moments.end),
        recovery=_recovery(name, groups, moments),
        impossible_payloads=sum(outcome.impossible_payloads for outcome in outcomes),
    )


_Squares = list[list[Array]]
"""Squares by cell and run."""


def _accuracy(quantity: Quantity, cells: Sequence[Sequence[_Judged]]) -> Accuracy:
    def expected(bound: Callable[[_Judged], TeamArrays]) -> _Squares:
        return [[quantity.expected_squares(bound(one).of(quantity)) for one in cell] for cell in cells]

    squares: _Squares = [[quantity.squares(one.errors.of(quantity)) for one in cell] for cell in cells]
    full, two_step = expected(lambda one: one.full), expected(lambda one: one.two_step or one.full)
    known = [np.isfinite(each) for each in chain.from_iterable(squares)]

    def root_where_known(values: _Squares) -> Number:
        return _number(root_mean([each[k] for each, k in zip(chain.from_iterable(values), known, strict=True)]))

    return Accuracy(
        rms=root_where_known(squares),
        bound_full=root_where_known(full),
        bound_two_step=root_where_known(two_step),
        ratio_two_step=_number(_scaled_ratio(squares, two_step).value),
        **_named("ratio_full", _scaled_ratio(squares, full)),
        **_named("nees", _nees(quantity, cells)),
        missing=int(sum(np.count_nonzero(~each) for each in known)),
    )


def _scaled_ratio(squares: _Squares, bounds: _Squares) -> Interval:
    """Return the ratio of root mean squares, with equal weights of all cells; a run's times and noises belong
    together.
    """
    scales = [float(np.mean(np.concatenate(cell))) for cell in bounds]
    runs = range(len(bounds[0]))

    def by_run(cells: _Squares) -> list[Array]:
        return [np.concatenate([cell[k] / scale for cell, scale in zip(cells, scales, strict=True)]) for k in runs]

    return ratio_of_roots(by_run(squares), by_run(bounds))


def _nees(quantity: Quantity, cells: Sequence[Sequence[_Judged]], confidence: float = 0.95) -> Interval:
    """Return the NEES of one robot or edge per run, each in turn, because those of one run are not independent."""
    errors, covariances = [], []
    for one in chain.from_iterable(cells):
        found, claimed = one.errors.of(quantity), one.errors.covariances.of(quantity)
        chosen, part = one.seed % len(found), quantity.components
        errors.append(found[chosen, part])
        covariances.append(claimed[chosen, part, part])
    return normalised_square(errors, covariances, confidence, alike=len(cells))


def _cells(quantities: Sequence[Quantity], cells: Sequence[Sequence[_Judged]]) -> Cells:

    def outside(confidence: float) -> int:
        found = [_nees(quantity, [cell], confidence) for quantity in quantities for cell in cells]
        return sum(not math.isnan(one.value) and not one.low <= one.value <= one.high for one in found)

    return Cells(len(quantities) * len(cells), outside(0.95), outside(0.9999))


def _claimed(every: Sequence[Errors], outcomes: Sequence[Outcome]) -> Claimed:
    found = [
        float(np.nanmax(in_stds(error, covariance)))
        for errors in every
        for error, covariance in (
            *zip(errors.payload, errors.covariances.payload, strict=True),
            *zip(errors.poses, errors.covariances.poses, strict=True),
        )
        if not np.isnan(error).all()
    ]
    return Claimed(
        count=len(found),
        contradicted=sum(not stds <= MOST_STDS for stds in found),
        most_stds=max(found, default=None),
        valid_numbers=sum(outcome.valid_numbers for outcome in outcomes),
        beyond_five=sum(outcome.beyond_five for outcome in outcomes),
    )


def _recovery(name: str, groups: Sequence[Sequence[Trial]], moments: Moments) -> Recovery | None:
    if moments.change is None:
        return None
    cells = [
        [
            _Judged(trial.seed, recovered, trial.recovery_bound)
            for trial in group
            if (recovered := trial.outcomes[name].recovered) is not None and trial.recovery_bound is not None
        ]
        for group in groups
    ]
    accuracies = {q.name: _accuracy(q, cells) for q in QUANTITIES if q.of_payload}
    result = {name: msgspec.convert(each, Recovered, from_attributes=True) for name, each in accuracies.items()}
    return Recovery(seconds_after=moments.after, **result)


def _number(value: float) -> Number:
    return value if math.isfinite(value) else None


def _named(name: str, interval: Interval) -> dict[str, Number]:
    """Return the fields of a number with its interval."""
    value, low, high = (_number(each) for each in (interval.value, interval.low, interval.high))
    return {name: value, f"{name}_low": low, f"{name}_high": high}

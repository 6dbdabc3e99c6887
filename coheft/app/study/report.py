"""What a study found, as the struct that becomes its JSON report."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from coheft.app.quantities import ALL_TEN, QUANTITIES, Quantity
from coheft.app.study.detection import Detection, judge_detection
from coheft.app.study.statistics import Interval, normalised_square, ratio_of_roots, root_mean
from coheft.app.study.trial import Moments, Outcome, Trial
from coheft.estimation.spatial import Array

Number = float | None
"""None where nothing was claimed, so nothing can be said."""


class Accuracy(msgspec.Struct, frozen=True):
    """How good the estimates of one quantity are, in SI units, over all robots or edges of all runs.

    Attributes:
        rms: Root mean square error, of a vector's or matrix's (Frobenius) norm.
        bound: Cramér-Rao bound of the same, for poses from kinematics and inertia from all sensors given those poses.
        bound_with_wrenches: The same if wrenches were used to find the poses as well.
        ratio: ``rms / bound``.
        ratio_low: Start of its 95 % sampling interval, over runs.
        ratio_high: End of it.
        nees: Normalised error squared per degree of freedom, of one robot per run: 1 if the stated covariance is right.
        nees_low: Start of the interval in which it lies in 95 of 100 studies with a right covariance.
        nees_high: End of it.
        missing: Estimates that no robot claimed a number for, in all runs; they are left out above.
    """

    rms: Number
    bound: Number
    bound_with_wrenches: Number
    ratio: Number
    ratio_low: Number
    ratio_high: Number
    nees: Number
    nees_low: Number
    nees_high: Number
    missing: int


class Consistency(msgspec.Struct, frozen=True):
    """Normalised error squared per degree of freedom, of one robot per run, and its 95 % interval."""

    nees: Number
    nees_low: Number
    nees_high: Number


class Recovered(msgspec.Struct, frozen=True):
    """Accuracy some time after the change; the bound is that of an estimator that was told the moment."""

    rms: Number
    bound: Number
    ratio: Number
    ratio_low: Number
    ratio_high: Number
    missing: int


class Recovery(msgspec.Struct, frozen=True):
    """After the load has changed.

    Attributes:
        seconds_after: Time since the change [s].
        mass: Of the new load.
        com: Its centre of mass.
        inertia: Its inertia.
    """

    seconds_after: float
    mass: Recovered
    com: Recovered
    inertia: Recovered


class EstimatorResult(msgspec.Struct, frozen=True):
    """All about one estimator. Both rotation and translation are of the neighbours' grasp frames in the own one."""

    pose_rotation: Accuracy
    pose_translation: Accuracy
    mass: Accuracy
    com: Accuracy
    inertia: Accuracy
    all_ten: Consistency
    decentralised_over_centralised: dict[str, Number]
    detection: Detection
    recovery: Recovery | None
    impossible_payloads: int


class NoiseResult(msgspec.Struct, frozen=True):
    """Results at one noise scale, by estimator."""

    noise_scale: float
    results: dict[str, EstimatorResult]


class StudyReport(msgspec.Struct, frozen=True):
    """The report of a study.

    Attributes:
        scenario: Its name.
        robots: Number of robots.
        seeds: First and last one.
        runs: Number of runs per noise scale.
        at_s: When accuracy was judged [s].
        units: Of ``rms`` and bounds.
        noise_scale: Factor on the scenario's noise, the first that was asked for.
        results: At that noise, by estimator.
        other_noise_scales: Results at the others.
    """

    scenario: str
    robots: int
    seeds: tuple[int, int]
    runs: int
    at_s: float
    units: dict[str, str]
    noise_scale: float
    results: dict[str, EstimatorResult]
    other_noise_scales: list[NoiseResult]

    def all_scales(self) -> list[NoiseResult]:
        """Results of all noise scales, in the order that was asked for."""
        return [NoiseResult(self.noise_scale, self.results), *self.other_noise_scales]


def summarise(trials: Sequence[Trial], moments: Moments) -> dict[str, EstimatorResult]:
    """Results by estimator, of runs that differ in their seed alone."""
    return {name: _of_estimator(name, trials, moments) for name in trials[0].outcomes}


def _of_estimator(name: str, trials: Sequence[Trial], moments: Moments) -> EstimatorResult:
    outcomes = [trial.outcomes[name] for trial in trials]
    accuracies = {quantity.name: _accuracy(quantity, name, trials) for quantity in QUANTITIES}
    nees = _nees(ALL_TEN, trials, outcomes)
    return EstimatorResult(
        **accuracies,
        all_ten=Consistency(_number(nees.value), _number(nees.low), _number(nees.high)),
        decentralised_over_centralised={q.name: _over_centralised(q, trials, outcomes) for q in QUANTITIES},
        detection=judge_detection([outcome.notices for outcome in outcomes], moments.change, moments.end),
        recovery=_recovery(name, trials, moments),
        impossible_payloads=sum(outcome.impossible_payloads for outcome in outcomes),
    )


def _accuracy(quantity: Quantity, name: str, trials: Sequence[Trial]) -> Accuracy:
    outcomes = [trial.outcomes[name] for trial in trials]
    squares = [quantity.squares(outcome.errors.of(quantity)) for outcome in outcomes]
    bounds = [quantity.expected_squares(trial.bound.of(quantity)) for trial in trials]
    with_wrenches = [quantity.expected_squares(trial.bound_with_wrenches.of(quantity)) for trial in trials]
    ratio, nees = ratio_of_roots(squares, bounds), _nees(quantity, trials, outcomes)
    return Accuracy(
        rms=_number(root_mean(squares)),
        bound=_number(root_mean(_where_known(bounds, squares))),
        bound_with_wrenches=_number(root_mean(_where_known(with_wrenches, squares))),
        ratio=_number(ratio.value),
        ratio_low=_number(ratio.low),
        ratio_high=_number(ratio.high),
        nees=_number(nees.value),
        nees_low=_number(nees.low),
        nees_high=_number(nees.high),
        missing=int(sum(np.isnan(s).sum() for s in squares)),
    )


def _nees(quantity: Quantity, trials: Sequence[Trial], outcomes: Sequence[Outcome]) -> Interval:
    """Of one robot or edge per run, because those of one run are not independent: each in turn."""
    errors, covariances = [], []
    for trial, outcome in zip(trials, outcomes, strict=True):
        found, claimed = outcome.errors.of(quantity), outcome.errors.covariances_of(quantity)
        chosen, part = trial.seed % len(found), quantity.components
        errors.append(found[chosen, part])
        covariances.append(claimed[chosen, part, part])
    return normalised_square(errors, covariances)


def _over_centralised(quantity: Quantity, trials: Sequence[Trial], outcomes: Sequence[Outcome]) -> Number:
    squares = [quantity.squares(outcome.errors.of(quantity)) for outcome in outcomes]
    references = [quantity.squares(trial.centralised.of(quantity)) for trial in trials]
    return _number(ratio_of_roots(squares, references).value)


def _recovery(name: str, trials: Sequence[Trial], moments: Moments) -> Recovery | None:
    if moments.change is None:
        return None
    found = {q.name: _recovered(q, name, trials) for q in QUANTITIES if q.of_payload}
    return Recovery(seconds_after=moments.after, **found)


def _recovered(quantity: Quantity, name: str, trials: Sequence[Trial]) -> Recovered:
    squares, bounds = [], []
    for trial in trials:
        errors, bound = trial.outcomes[name].recovered, trial.recovery_bound
        if errors is None or bound is None:
            raise ValueError("the load must change in all runs or in none")
        squares.append(quantity.squares(errors.of(quantity)))
        bounds.append(quantity.expected_squares(bound.of(quantity)))
    ratio = ratio_of_roots(squares, bounds)
    return Recovered(
        rms=_number(root_mean(squares)),
        bound=_number(root_mean(_where_known(bounds, squares))),
        ratio=_number(ratio.value),
        ratio_low=_number(ratio.low),
        ratio_high=_number(ratio.high),
        missing=int(sum(np.isnan(s).sum() for s in squares)),
    )


def _where_known(values: Sequence[Array], like: Sequence[Array]) -> list[Array]:
    return [np.where(np.isfinite(other), value, np.nan) for value, other in zip(values, like, strict=True)]


def _number(value: float) -> Number:
    return value if math.isfinite(value) else None

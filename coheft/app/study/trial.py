"""One run of a study: every estimator with the same motion and noise, compared with the truth."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

import msgspec
import numpy as np

from coheft.app.results.errors import VALID_STDS
from coheft.app.results.judge import Judge
from coheft.app.results.points import make_point, sizes
from coheft.app.results.quantities import (
    QUANTITIES,
    Edges,
    Errors,
    TeamArrays,
    directed_edges,
    payload_exists,
    published_errors,
)
from coheft.app.run.inprocess import run_in_process
from coheft.app.study.bounds import ExactRun
from coheft.app.study.samples import simulate, with_exact_sensors
from coheft.estimation.geometry.spatial import Array
from coheft.wire.messages.structs import Estimate, LoadChangeNotice, Validity
from coheft.wire.scenario.schema import Scenario


@dataclass(frozen=True)
class Moments:
    """Times at which a run is evaluated.

    Attributes:
        at: Times for the accuracy, in order [s].
        change: Time of the load change, at the start of a block [s]; None if there is none.
        after: Time from the change to the evaluation of the recovery [s].
    """

    at: tuple[float, ...]
    change: float | None
    after: float

    @property
    def end(self) -> float:
        """Length of the run [s]."""
        return self.at[-1] if self.change is None else max(self.at[-1], self.change + self.after)


@dataclass(frozen=True, eq=False)
class Curves:
    """Errors of the first robot over time [s].

    They are norms by quantity, root mean square over its edges, with its own standard deviations of these, (n, 5) each.
    """

    times: Array
    errors: Array
    deviations: Array


@dataclass(frozen=True, eq=False)
class Outcome:
    """Results of one estimator.

    Attributes:
        errors: Errors at each time for the accuracy.
        recovered: Errors some time after the load change; None if there is none.
        impossible_payloads: Number of published estimates of payloads that cannot exist.
        converged: Share of robots that have converged, at each time for the accuracy.
        valid_numbers: Numbers in valid estimates, each time that a robot reports.
        beyond_five: How many of them are off by more than five of their own standard deviations, which none should be.
    """

    errors: tuple[Errors, ...]
    recovered: Errors | None
    notices: dict[str, list[LoadChangeNotice]]
    impossible_payloads: int
    curves: Curves
    converged: tuple[float, ...]
    valid_numbers: int
    beyond_five: int


@dataclass(frozen=True, eq=False)
class Trial:
    """Results and bounds of one run.

    Attributes:
        seed: Seed of the sensors' noise and the motions.
        full: Bound for poses and inertia from all sensors, at each time for the accuracy.
        two_step: Bound for poses from kinematics, and inertia from all sensors given those poses.
        recovery_bound: Like ``full``, after the load change, for an estimator that knows its time.
    """

    seed: int
    outcomes: dict[str, Outcome]
    full: tuple[TeamArrays, ...]
    two_step: tuple[TeamArrays, ...]
    recovery_bound: TeamArrays | None


def run_trial(scenario: Scenario, estimators: Sequence[str], moments: Moments) -> Trial:
    """Run a scenario once per estimator."""
    scenario = msgspec.structs.replace(scenario, duration=moments.end)
    exact = simulate(with_exact_sensors(scenario))
    edges = directed_edges(exact.scene.neighbours)
    run = ExactRun(scenario, exact, edges)
    blocks = [0, *(round(moment / scenario.block_duration) for moment in moments.at)]
    known = list(accumulate(run.information(first, end) for first, end in pairwise(blocks)))
    recovery_bound = None
    if moments.change is not None:
        change = round(moments.change / scenario.block_duration)
        before = known[-1] + run.information(blocks[-1], change)
        new = run.information(change, scenario.blocks)
        recovery_bound = run.seen((new + before.with_another_load()).full_bound())
    return Trial(
        seed=scenario.seed,
        outcomes={name: _outcome(scenario, name, moments, run.judge, edges) for name in estimators},
        full=tuple(run.seen(information.full_bound()) for information in known),
        two_step=tuple(run.seen(information.two_step_bound()) for information in known),
        recovery_bound=recovery_bound,
    )


def _outcome(scenario: Scenario, estimator: str, moments: Moments, judge: Judge, edges: Edges) -> Outcome:
    chosen = msgspec.structs.replace(scenario, estimator=estimator)
    reports = [record.estimates for record in run_in_process(chosen) if record.estimates]
    last = _latest(reports, moments.end)
    valid = [e for each in reports for e in each.values() if e.status is Validity.VALID]
    stds = np.concatenate([np.empty(0), *(part for e in valid for part in judge.in_stds(e).values())])
    return Outcome(
        errors=tuple(published_errors(judge, edges, _latest(reports, moment)) for moment in moments.at),
        recovered=None if moments.change is None else published_errors(judge, edges, last),
        notices={name: list(estimate.load_changes) for name, estimate in last.items()},
        impossible_payloads=sum(not payload_exists(e.payload) for report in reports for e in report.values()),
        curves=_curves(judge, reports),
        converged=tuple(
            float(np.mean([e.is_converged for e in _latest(reports, moment).values()])) for moment in moments.at
        ),
        valid_numbers=len(stds),
        beyond_five=int(np.count_nonzero(stds > VALID_STDS)),
    )


def _latest(reports: Sequence[dict[str, Estimate]], time: float) -> dict[str, Estimate]:
    """Return the last estimates that all robots published up to a time."""
    latest: dict[str, Estimate] = {}
    for report in reports:
        latest.update({name: estimate for name, estimate in report.items() if estimate.time <= time + 1e-9})
    return latest


def _curves(judge: Judge, reports: Sequence[dict[str, Estimate]]) -> Curves:
    first = judge.scene.robots[0]
    # Some reports are of other robots only, when their doubts changed.
    points = [make_point(judge, report[first]) for report in reports if first in report]
    found = []
    for quantity in QUANTITIES:
        neighbours = [None] if quantity.of_payload else judge.scene.neighbours[first]
        squares = [np.square(sizes(points, quantity, neighbour)) for neighbour in neighbours]
        found.append(np.sqrt(np.mean(squares, axis=0)))
    errors, deviations = np.stack(found, axis=2)
    return Curves(np.array([point.time for point in points]), errors, deviations)

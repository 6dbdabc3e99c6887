"""Many runs with carts, in parallel: tests, seeds, with and without the estimator."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from coheft.app.cart.inprocess import CartRun, run_in_process
from coheft.app.cart.judge import CartReport, judge, tracking_errors
from coheft.app.run.parallel import side_by_side, workers
from coheft.estimation.geometry.spatial import Array
from coheft.wire.cart.scenario import CartScenario


class Case(NamedTuple):
    """A run to be done: the number of its test in Table I, and its scenario."""

    test: int
    scenario: CartScenario


@dataclass(frozen=True, eq=False)
class Outcome:
    """A run with its errors, and the data of its figures.

    Attributes:
        times: Times of the tracking errors [s], shape (samples,).
        tracking_errors: Distances from the reference [m], shape (samples,).
        masses: Times [s], the first pusher's estimates and their standard deviations [kg], shape (estimates, 3).
        true_masses: True masses at ``times`` [kg], shape (samples,).
    """

    case: Case
    report: CartReport
    times: Array
    tracking_errors: Array
    masses: Array
    true_masses: Array


Run = Callable[[CartScenario], CartRun]


def run_cases(cases: Sequence[Case], jobs: int, run: Run) -> Iterator[Outcome]:
    """Run all cases with ``run``, or in so many ``workers``, and yield their outcomes as they arrive."""
    if jobs == 1:
        yield from (_outcome(case, run) for case in cases)
    else:
        with workers(jobs):
            yield from side_by_side(_outcome, ((case, run_in_process) for case in cases))


def _outcome(case: Case, run: Run) -> Outcome:
    done = run(case.scenario)
    times, errors = tracking_errors(done)
    first = done.estimates[done.scenario.names[0]]
    return Outcome(
        case=case,
        report=judge(done, case.test),
        times=times,
        tracking_errors=errors,
        masses=np.array([(e.time, e.cart.mass, np.sqrt(e.covariance[0, 0])) for e in first]),
        true_masses=np.array([truth.cart.mass for truth in done.truths]),
    )

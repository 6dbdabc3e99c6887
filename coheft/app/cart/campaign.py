"""Many runs with carts: all tests, many seeds, with and without the estimator, on all cores."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from coheft.app.cart.inprocess import CartRun, run_in_process
from coheft.app.cart.judge import CartReport, judge
from coheft.app.cart.table_one import table_one
from coheft.errors import MissingPackageError


@dataclass(frozen=True)
class Case:
    """One run to be done.

    Attributes:
        test: Number in Table I.
        seed: Of the noise.
        learns: With the estimator, or without.
        pushers: How many.
        friction_guess: See ``table_one``.
    """

    test: int
    seed: int
    learns: bool = True
    pushers: int = 1
    friction_guess: float | None = None


def run_case(case: Case) -> CartRun:
    """Run it in this process.

    Raises:
        SimulationError: The cart has gone out of sight.
    """
    return run_in_process(
        table_one(
            case.test,
            seed=case.seed,
            learns=case.learns,
            pushers=case.pushers,
            friction_guess=case.friction_guess,
        )
    )


def judge_cases(
    cases: Sequence[Case], jobs: int = 1, on_progress: Callable[[int], None] = lambda done: None
) -> list[CartReport]:
    """Run and judge cases; the reports come in their order.

    Args:
        cases: What to run.
        jobs: Number of processes.
        on_progress: Told the number of runs that are done.

    Raises:
        MissingPackageError: More than one process is asked for, but the package for it is not installed.
        SimulationError: A cart has gone out of sight.
    """
    found: dict[Case, CartReport] = {}
    for done, (case, report) in enumerate(_reports(cases, jobs), start=1):
        found[case] = report
        on_progress(done)
    return [found[case] for case in cases]


def _reports(cases: Sequence[Case], jobs: int) -> Iterable[tuple[Case, CartReport]]:
    if jobs == 1:
        return map(_judged, cases)
    try:
        import joblib
    except ImportError as error:
        raise MissingPackageError("joblib", "study") from error
    parallel = joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")
    results: Iterable[tuple[Case, CartReport]] = parallel(joblib.delayed(_judged)(case) for case in cases)
    return results


def _judged(case: Case) -> tuple[Case, CartReport]:
    return case, judge(run_case(case), case.test)

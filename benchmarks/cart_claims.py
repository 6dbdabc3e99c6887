"""Checks of what pushers of a cart report as known, with random turning friction and loads.

``python -m benchmarks.cart_claims --seeds 20`` runs the tests of Table I with 20 seeds each, and counts
the reports of known quantities with errors within five of their own standard deviations.
"""

from collections import Counter
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from msgspec import structs

from benchmarks.command import run_command
from coheft.app.cart.inprocess import CartRun, run_in_process
from coheft.app.cart.judge import MASS_AT, judge
from coheft.app.cart.table_one import TESTS, table_one
from coheft.app.run.parallel import side_by_side, workers
from coheft.estimation.cart.model import CartBody
from coheft.estimation.cart.observability import QUANTITIES
from coheft.estimation.geometry.spatial import Array
from coheft.wire.cart.scenario import CartScenario

_WITHIN = 5.0
"""Largest error [standard deviations]."""


def scenario(test: int, seed: int, friction_guess: float | None) -> CartScenario:
    """Return a test with random turning friction, 0.2 to 2 times the translational one, and crates of random size."""
    rng = np.random.default_rng([seed, test])
    found = table_one(
        test, seed=seed, friction_guess=friction_guess, turning_friction=float(np.exp(rng.uniform(*np.log([0.2, 2.0]))))
    )
    size = rng.uniform(0.2, 0.9), rng.uniform(0.2, 0.6)
    middle = 0.3 + rng.uniform(-0.15, 0.15), rng.uniform(-0.1, 0.1)
    return structs.replace(found, loads=tuple(structs.replace(load, size=size, place=middle) for load in found.loads))


def errors(run: CartRun) -> Array:
    """Return errors in own standard deviations, shape (reports, quantities); NaN where not known."""
    result = []
    for report in run.estimates["p1"]:
        error = _numbers(report.cart) - _numbers(run.truths[report.block].cart)
        deviations = np.sqrt(np.diag(report.covariance))
        claimed = np.array([name not in report.not_known for name in QUANTITIES]) & (deviations > 0.0)
        result.append(np.where(claimed, error / np.where(claimed, deviations, 1.0), np.nan))
    return np.array(result)


def _numbers(cart: CartBody) -> Array:
    return np.array([cart.mass, *cart.com, cart.inertia, *cart.friction])


def _judged(test: int, seed: int, friction_guess: float | None) -> tuple[int, int, CartRun, Array]:
    run = run_in_process(scenario(test, seed, friction_guess))
    return test, seed, run, errors(run)


def main(
    *,
    tests: Annotated[tuple[int, ...], Parameter(consume_multiple=True)] = TESTS,
    seeds: int = 20,
    first_seed: int = 1,
    friction_guess: float | None = None,
    jobs: int = 2,
) -> None:
    """Run, and print a line for each wrong run, and a summary.

    Args:
        tests: Numbers of tests in Table I.
        seeds: Number of seeds of each test.
        first_seed: The first of them.
        friction_guess: As in 'coheft cart'; by default the friction is known.
        jobs: Number of processes.
    """
    cases = [(test, seed, friction_guess) for test in tests for seed in range(first_seed, first_seed + seeds)]
    claimed: Counter[str] = Counter()
    wrong: Counter[str] = Counter()
    masses: dict[int, list[float]] = {test: [] for test in tests}
    with workers(jobs):
        for test, seed, run, found in side_by_side(_judged, cases):
            report = judge(run, test)
            masses[test].append(abs(report.mass_error_kg))
            far = np.abs(found) > _WITHIN
            words = []
            for index, name in enumerate(QUANTITIES):
                claimed[name] += int(np.isfinite(found[:, index]).sum())
                wrong[name] += int(far[:, index].sum())
                if far[:, index].any():
                    first = run.estimates["p1"][int(np.flatnonzero(far[:, index])[0])].time
                    words.append(
                        f"{name} {np.nanmax(np.abs(found[:, index])):.1f} ({far[:, index].sum()} from {first:g} s)"
                    )
            if words or report.jumps != len(run.scenario.loads) or abs(report.mass_error_kg) > 0.3:
                words.append(f"mass off {report.mass_error_kg:.3f} kg, {report.jumps} jumps")
                print(f"test {test}, seed {seed}: {'; '.join(words)}", flush=True)
    for test, off in masses.items():
        print(f"test {test}: mass at {MASS_AT:g} s off by {np.median(off):.3f} kg, at most {max(off):.3f} kg")
    for name in QUANTITIES:
        print(f"{name}: {wrong[name]} of {claimed[name]} claims are farther off than {_WITHIN:g} standard deviations")
    share = 1.0 - wrong.total() / max(claimed.total(), 1)
    print(f"all: {100 * share:.3f} % of {claimed.total()} claims are within {_WITHIN:g} standard deviations")


if __name__ == "__main__":
    run_command(main, __doc__)

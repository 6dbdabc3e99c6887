"""The command that evaluates estimators over many runs."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from coheft.app.cli import options
from coheft.app.cli.base import EVALUATE, EXIT_CONVERGED, app
from coheft.errors import UsageError

if TYPE_CHECKING:
    from coheft.app.study.campaign import Plan
    from coheft.app.study.report import StudyReport


def _estimators(text: str) -> list[str]:
    """Return different estimators, named with commas between them, or raise a ``ValueError``."""
    from coheft.wire.former_names import present
    from coheft.wire.scenario.errors import did_you_mean
    from coheft.wire.scenario.plugins import available

    words, there = [present(word.strip()) for word in text.split(",")], available("estimator")
    unknown = [word for word in words if word not in there]
    if unknown or len(set(words)) < len(words):
        hint = f".{did_you_mean(unknown[0], there)}" if unknown else ""
        raise ValueError(f"expected different ones of {', '.join(there)}, separated by commas; found {text!r}{hint}")
    return words


def _factors(text: str) -> list[float]:
    """Return different positive numbers, with commas between them, or raise a ``ValueError``."""
    with suppress(ValueError):
        factors = [float(word) for word in text.split(",")]
        if all(0.0 < factor < math.inf for factor in factors) and len(set(factors)) == len(factors):
            return factors
    raise ValueError(f"expected different positive numbers, separated by commas; found {text!r}")


Factors = Annotated[str, Parameter(validator=lambda _, text: _factors(text))]


def _is_rate(_: object, rate: int | None) -> None:
    from coheft.wire.scenario.schema import SENSOR_RATES

    if rate is not None and rate not in SENSOR_RATES:
        raise ValueError(f"expected one of {', '.join(map(str, SENSOR_RATES))}; found {rate}")


@app.command(group=EVALUATE)
def study(
    scenario: str = "ring6",
    *,
    set: Annotated[list[str] | None, Parameter(negative=())] = None,
    vary: str | None = None,
    runs: options.Count = 50,
    estimators: Annotated[str, Parameter(validator=lambda _, text: _estimators(text))] = "fan2017,efficient",
    noise: Factors = "1",
    at: Factors = "20",
    after: options.Positive = 1.0,
    first_seed: options.NotNegative = 1,
    sensor_rate: Annotated[options.Whole | None, Parameter(validator=_is_rate)] = None,
    jobs: options.Jobs = None,
    dask: str | None = None,
    json: options.ReportTarget = None,
    report: options.FolderTarget = None,
    quiet: options.Quiet = False,
) -> int:
    """Compare estimators with the Cramér-Rao bound over many runs, each in one process with a simulated network.

    Each run has its own seed for the sensors' noise and the robots' motions; all estimators get the same runs.

    Args:
        scenario: Name of a shipped scenario (see 'coheft scenarios'), a path that ends with .toml, or 'random' for a
            new random team in every run.
        set: Set a key of the scenario, in TOML syntax, for instance sensors.noise_scale=3. May be repeated.
        vary: Run a study for each of several values of a key, for instance sensors.rate=100,500, and compare them in a
            table. The JSON then holds all studies.
        runs: Number of runs for each noise scale.
        estimators: Estimators to compare, separated by commas.
        noise: Factors applied to the scenario's noise, for instance 1,3.
        at: Times at which accuracy is judged [s], for instance 2,5,10; they must be before the first change of the
            load.
        after: Time after the first change of the load at which the recovery is judged [s].
        first_seed: Seed of the first run; the others follow consecutively.
        sensor_rate: Samples per second, instead of the scenario's; the duration of a block stays the same.
        dask: Address of a Dask scheduler whose workers do all runs.
        report: Folder for a report with pictures.
    """
    from functools import partial

    from msgspec import structs
    from rich.console import Console

    from coheft.app.figures import picture_folder
    from coheft.app.outputs import write_outputs
    from coheft.app.results.report import write_report
    from coheft.app.study.campaign import make_plan, run_study
    from coheft.app.study.output import Variant, VariedReport, print_study, print_varied, write_folder
    from coheft.app.study.random_team import RANDOM
    from coheft.app.terminal.notes import print_notes
    from coheft.app.terminal.progress import show_progress
    from coheft.wire.scenario.file import load_scenario, scenario_path
    from coheft.wire.scenario.set_values import varied_values

    def planned(values: list[str]) -> Plan:
        return make_plan(
            None if scenario == RANDOM else load_scenario(scenario, values),
            values=values,
            runs=runs,
            estimators=_estimators(estimators),
            noise_scales=_factors(noise),
            at=_factors(at),
            after=after,
            first_seed=first_seed,
            sensor_rate=sensor_rate,
        )

    varied = [] if vary is None else varied_values(vary)
    plans = [planned([*(set or ()), value]) for value in varied] or [planned(set or [])]
    if jobs is not None and dask is not None:
        raise UsageError("--jobs is for processes on this machine, but --dask uses other workers: leave one out")
    if varied and report is not None:
        raise UsageError("--report shows one study, but --vary makes several: leave one out; --json contains all")
    options.check_outputs(*([] if scenario == RANDOM else [scenario_path(scenario)]), json=json, report=report)
    console = Console(stderr=json == "-", quiet=quiet)
    for plan in plans:
        for name in plan.estimators:
            print_notes(console, structs.replace(plan.of_seed(first_seed), estimator=name))
    found: list[StudyReport] = []
    total = sum(plan.runs for plan in plans)
    with picture_folder(report), show_progress(console, "runs", total) as progress:
        for plan in plans:
            study_report, trials = run_study(plan, jobs=jobs, dask=dask, on_progress=progress)
            found.append(study_report)
    if varied:
        variants = VariedReport([Variant(value, each) for value, each in zip(varied, found, strict=True)])
        print_varied(console, variants)
        write_outputs((json, partial(write_report, variants)))
    else:
        print_study(console, found[0])
        write_outputs((json, partial(write_report, found[0])), (report, partial(write_folder, found[0], trials)))
    return EXIT_CONVERGED

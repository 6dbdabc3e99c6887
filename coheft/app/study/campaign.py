"""Planning and running of a study, on all cores or on a cluster."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import msgspec

from coheft.app.results.quantities import UNITS
from coheft.app.run.parallel import side_by_side, workers
from coheft.app.study.random_team import RANDOM, random_team
from coheft.app.study.report import Cell, StudyReport, summarise
from coheft.app.study.trial import Moments, Trial, run_trial
from coheft.errors import ScenarioError
from coheft.wire.scenario.borders import first_border
from coheft.wire.scenario.checks import noise_complaints
from coheft.wire.scenario.rules import check
from coheft.wire.scenario.schema import Scenario

_LEAST_BLOCK = 2


@dataclass(frozen=True)
class Plan:
    """Runs of a study, and when they are evaluated.

    Attributes:
        name: Name of the scenario, or ``RANDOM``.
        of_seed: Returns the scenario of a seed. Recovery is evaluated after its first load change; there are no later
            ones.
        seeds: Seeds of the runs, the same for each noise scale.
    """

    name: str
    of_seed: Callable[[int], Scenario]
    estimators: tuple[str, ...]
    noise_scales: tuple[float, ...]
    seeds: range
    moments: Moments

    @property
    def runs(self) -> int:
        """Number of runs; those of several estimators on the same data count once."""
        return len(self.seeds) * len(self.noise_scales)

    def scenarios(self) -> Iterator[tuple[float, Scenario]]:
        """Yield all runs' scenarios with their noise factors, one factor after the other."""
        for factor in self.noise_scales:
            for seed in self.seeds:
                scenario = self.of_seed(seed)
                sensors = scenario.sensors
                scaled = msgspec.structs.replace(sensors, noise_scale=factor * sensors.noise_scale)
                yield factor, msgspec.structs.replace(scenario, sensors=scaled, seed=seed)


def make_plan(
    scenario: Scenario | None,
    *,
    values: Sequence[str] = (),
    runs: int,
    estimators: Sequence[str],
    noise_scales: Sequence[float] = (1.0,),
    at: Sequence[float] = (20.0,),
    after: float = 1.0,
    first_seed: int = 1,
    sensor_rate: int | None = None,
) -> Plan:
    """Plan a study; arguments are the options of ``coheft study``.

    A ``scenario`` is that of every run, apart from noise and seed, and has its ``values`` already; None stands for a
    different random team in each run, with these values (see ``set_values``).

    Raises:
        ScenarioError: The load changes before accuracy is evaluated, there is too little noise, or a block is not a
            whole number of samples.
    """
    first = _at_rate(random_team(first_seed, values) if scenario is None else scenario, sensor_rate)
    name = RANDOM if scenario is None else scenario.name
    block = first.block_duration
    # A change takes effect at the start of the next block.
    changes = [(block * first_border(change.at, block), change) for change in first.load_changes]
    change = min((moment for moment, _ in changes), default=None)
    chosen = msgspec.structs.replace(first, load_changes=tuple(c for moment, c in changes if moment == change))

    if first.slips:
        raise ScenarioError(
            f"{name}: key 'slips': found {len(first.slips)}, but the bounds of a study are for grasps that do not "
            f"slip: leave them out, or choose another scenario"
        )

    def of_seed(seed: int) -> Scenario:
        return chosen if scenario is not None else _at_rate(random_team(seed, values), sensor_rate)

    judged = sorted({block * max(1, round(moment / block)) for moment in at})
    if change is not None and change < judged[-1] - 0.5 * block:
        raise ScenarioError(
            f"{name}: the load changes at {change:g} s, but accuracy is evaluated at {judged[-1]:g} s: choose an "
            f"earlier time (--at), or a scenario whose load does not change before"
        )
    plan = Plan(
        name,
        of_seed,
        tuple(estimators),
        tuple(noise_scales),
        range(first_seed, first_seed + runs),
        Moments(tuple(judged), change, after),
    )
    for _, run in plan.scenarios():
        check(run, name, noise_complaints)
    return plan


def _at_rate(scenario: Scenario, rate: int | None) -> Scenario:
    """Return the scenario with another sensor rate, and blocks of the same duration."""
    if rate is None:
        return scenario
    sensors = scenario.sensors
    block = sensors.block * rate / sensors.rate
    if block != round(block) or round(block) < _LEAST_BLOCK:
        raise ScenarioError(
            f"{scenario.name}: --sensor-rate {rate} makes {block:g} samples of a block of {scenario.block_duration:g} "
            f"s, expected a whole number of at least {_LEAST_BLOCK}: choose another rate"
        )
    changed = msgspec.structs.replace(sensors, rate=rate, block=round(block))
    return msgspec.structs.replace(scenario, sensors=changed)


def run_study(
    plan: Plan,
    *,
    jobs: int | None = None,
    dask: str | None = None,
    on_progress: Callable[[], None] = lambda: None,
) -> tuple[StudyReport, list[Trial]]:
    """Run a study; return the report, and the runs at the first noise scale in the order of their seeds.

    See ``workers`` for ``jobs`` and ``dask``; ``on_progress`` is called after each run.
    """
    trials: dict[tuple[float, int], Trial] = {}
    with workers(jobs, dask):
        tasks = ((factor, scenario, plan.estimators, plan.moments) for factor, scenario in plan.scenarios())
        for key, trial in side_by_side(_keyed_trial, tasks):
            trials[key] = trial
            on_progress()
    by_factor = {factor: [trials[factor, seed] for seed in plan.seeds] for factor in plan.noise_scales}
    report = StudyReport(
        scenario=plan.name,
        seeds=(plan.seeds[0], plan.seeds[-1]),
        runs=len(plan.seeds),
        at_s=list(plan.moments.at),
        noise_scales=list(plan.noise_scales),
        units=UNITS,
        results=summarise(list(by_factor.values()), plan.moments, range(len(plan.moments.at))),
        cells=[
            Cell(factor, at, summarise([group], plan.moments, [k]))
            for factor, group in by_factor.items()
            for k, at in enumerate(plan.moments.at)
        ],
    )
    return report, by_factor[plan.noise_scales[0]]


def _keyed_trial(
    factor: float, scenario: Scenario, estimators: Sequence[str], moments: Moments
) -> tuple[tuple[float, int], Trial]:
    return (factor, scenario.seed), run_trial(scenario, estimators, moments)

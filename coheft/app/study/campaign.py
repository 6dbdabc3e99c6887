"""Many runs over all cores, or over a cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import msgspec

from coheft.app.parallel import side_by_side, workers
from coheft.app.quantities import UNITS
from coheft.app.study.report import NoiseResult, StudyReport, summarise
from coheft.app.study.trial import Moments, Trial, run_trial
from coheft.errors import ScenarioError
from coheft.wire.borders import first_border
from coheft.wire.scenario import Scenario
from coheft.wire.scenario_checks import check_noise


@dataclass(frozen=True)
class Plan:
    """What a study runs.

    Attributes:
        scenario: Its first load change is the one to recover from; there are no later ones.
        estimators: To be compared.
        noise_scales: Factors on the scenario's noise.
        seeds: One run each, per noise scale.
        moments: When runs are judged.
    """

    scenario: Scenario
    estimators: tuple[str, ...]
    noise_scales: tuple[float, ...]
    seeds: range
    moments: Moments

    @property
    def runs(self) -> int:
        """Number of runs, an estimator beside another on the same data counted once."""
        return len(self.seeds) * len(self.noise_scales)

    def scenarios(self) -> Iterator[Scenario]:
        """All runs' scenarios, one noise scale after the other."""
        sensors = self.scenario.sensors
        for scale in self.noise_scales:
            scaled = msgspec.structs.replace(sensors, noise_scale=scale * sensors.noise_scale)
            for seed in self.seeds:
                yield msgspec.structs.replace(self.scenario, sensors=scaled, seed=seed)


def make_plan(
    scenario: Scenario,
    *,
    runs: int,
    estimators: Sequence[str],
    noise_scales: Sequence[float] = (1.0,),
    at: float = 20.0,
    after: float = 1.0,
    first_seed: int = 1,
) -> Plan:
    """Plan a study.

    Args:
        scenario: Of every run, but for noise and seed.
        runs: Per noise scale.
        estimators: To be compared.
        noise_scales: Factors on the scenario's noise.
        at: When accuracy is judged [s], before the load changes.
        after: From the load's change to the judgement of the recovery [s].
        first_seed: Seeds are counted from here.

    Raises:
        ScenarioError: The load changes before accuracy is to be judged, or there is too little noise to speak of.
    """
    block = scenario.block_duration
    # A change takes effect at the next border of a block.
    changes = [(block * first_border(change.at, block), change) for change in scenario.load_changes]
    change = min((moment for moment, _ in changes), default=None)
    at = block * max(1, round(at / block))
    if change is not None and change < at - 0.5 * block:
        raise ScenarioError(
            f"{scenario.name}: the load changes at {change:g} s, but accuracy is to be judged at {at:g} s: "
            f"choose an earlier time (--at), or a scenario whose load stays as it is until then"
        )
    plan = Plan(
        msgspec.structs.replace(scenario, load_changes=tuple(other for moment, other in changes if moment == change)),
        tuple(estimators),
        tuple(noise_scales),
        range(first_seed, first_seed + runs),
        Moments(at, change, after),
    )
    for run in plan.scenarios():
        check_noise(run, scenario.name)
    return plan


def run_study(
    plan: Plan,
    *,
    jobs: int | None = None,
    dask: str | None = None,
    on_progress: Callable[[int], None] = lambda done: None,
) -> tuple[StudyReport, list[Trial]]:
    """Run a study.

    Args:
        plan: What to run.
        jobs: Number of processes; None for one per core.
        dask: Address of a Dask scheduler whose workers run it, instead of this machine's cores.
        on_progress: Told the number of runs that are done.

    Returns:
        The report, and the runs at the first noise scale in the order of their seeds.

    Raises:
        MissingPackageError: A package that studies need is not installed.
    """
    trials: dict[tuple[float, int], Trial] = {}
    with workers(jobs, dask):
        tasks = ((scenario, plan.estimators, plan.moments) for scenario in plan.scenarios())
        for done, (key, trial) in enumerate(side_by_side(_keyed_trial, tasks), start=1):
            trials[key] = trial
            on_progress(done)
    own = plan.scenario.sensors.noise_scale
    by_scale = [[trials[scale * own, seed] for seed in plan.seeds] for scale in plan.noise_scales]
    results = [
        NoiseResult(scale, summarise(group, plan.moments))
        for scale, group in zip(plan.noise_scales, by_scale, strict=True)
    ]
    report = StudyReport(
        scenario=plan.scenario.name,
        robots=plan.scenario.robot_count,
        seeds=(plan.seeds[0], plan.seeds[-1]),
        runs=len(plan.seeds),
        at_s=plan.moments.at,
        units=UNITS,
        noise_scale=results[0].noise_scale,
        results=results[0].results,
        other_noise_scales=results[1:],
    )
    return report, by_scale[0]


def _keyed_trial(scenario: Scenario, estimators: Sequence[str], moments: Moments) -> tuple[tuple[float, int], Trial]:
    return (scenario.sensors.noise_scale, scenario.seed), run_trial(scenario, estimators, moments)

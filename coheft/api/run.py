"""Runs in Python: complete, or block by block."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from coheft.api.collector import Collector
from coheft.api.result import Result
from coheft.api.scenario import Source, load_scenario
from coheft.api.simulation import Simulation
from coheft.app.run.overrides import override
from coheft.errors import UsageError
from coheft.wire.scenario.schema import Scenario


def run(
    scenario: Source = "ring6",
    *,
    duration: float | None = None,
    seed: int | None = None,
    estimator: str | None = None,
    set: Mapping[str, Any] | None = None,
    processes: bool = False,
    restarts: int | None = None,
) -> Result:
    """Run a scenario to its end.

    Args:
        scenario: Name of a shipped scenario, path of a ``.toml`` file, dictionary with its keys, or a ``Scenario``.
        duration: Simulated time [s], instead of the scenario's.
        seed: Seed of the sensors' noise and the robots' motions, instead of the scenario's.
        estimator: The robots' estimator: ``efficient``, ``fan2017``, or one of your own. With several, as in
            ``efficient,fan2017``, each robot runs them side by side; the first is its own.
        set: Other values by key, as in ``load_scenario``; the arguments above take precedence.
        processes: Start the physics server and a process for each robot, as ``coheft run`` does, instead of computing
            all in this process. The numbers are the same.
        restarts: How often an agent that dies is restarted, with ``processes`` only; 3 by default.

    Raises:
        ScenarioError: There is no such scenario, or it cannot be used.
        SimulationError: The robots have lost the payload.
        ProcessError: With ``processes``: one of them has failed.
    """
    chosen = override(
        load_scenario(scenario, set=set), duration=duration, seed=seed, estimator=estimator, origin="coheft.run"
    )
    if processes:
        return _run_processes(chosen, restarts=3 if restarts is None else restarts)
    if restarts is not None:
        raise UsageError("restarts= is only for runs with processes: add processes=True, or leave it out")
    simulation = Simulation(chosen)
    simulation.step(chosen.blocks)
    result = simulation.result()
    if not result.beside or simulation.truth is None:
        return result
    from coheft.app.study.bounds import with_bound

    return replace(result, report=with_bound(result.report, chosen, simulation.truth))


def simulate(
    scenario: Source = "ring6",
    *,
    duration: float | None = None,
    seed: int | None = None,
    estimator: str | None = None,
    set: Mapping[str, Any] | None = None,
) -> Simulation:
    """Build a simulation to be run step by step; arguments as for ``run``.

    Raises:
        ScenarioError: There is no such scenario, or it cannot be used.
    """
    loaded = load_scenario(scenario, set=set)
    return Simulation(override(loaded, duration=duration, seed=seed, estimator=estimator, origin="coheft.simulate"))


def _run_processes(scenario: Scenario, *, restarts: int) -> Result:
    """Start the physics server and a process per robot, and follow them to the end."""
    from coheft.app.run.folder import make_run_folder
    from coheft.app.run.launch import launch
    from coheft.app.run.plan import make_plan, new_run_name
    from coheft.app.terminal.screen import Display

    name, collector = new_run_name(), Collector()
    folder = make_run_folder(name)
    report = launch(make_plan(scenario, run=name), folder, Display(), followers=[collector], restarts=restarts)
    return collector.result(scenario, report)

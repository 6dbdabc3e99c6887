"""Notes about valid settings that contradict each other, and may not be intended: printed before a run."""

import msgspec
from rich.console import Console

from coheft.app.names import few
from coheft.estimation.tolerance import SensorTolerance
from coheft.wire.scenario.change_checks import late_changes
from coheft.wire.scenario.plugins import estimator_names
from coheft.wire.scenario.schema import Scenario

_MOST_NAMED = 4


def print_notes(console: Console, scenario: Scenario) -> None:
    """Print a line for each note on a scenario."""
    for note in notes(scenario):
        text = f"Note: {note}."
        console.print(text, style="yellow", markup=False, highlight=False, soft_wrap=not console.is_terminal)


def notes(scenario: Scenario) -> list[str]:
    """Return one sentence for each contradiction between settings of a valid scenario; usually none."""
    return [*_undeclared_errors(scenario), *_exact_method(scenario), *_never(scenario)]


def _undeclared_errors(scenario: Scenario) -> list[str]:
    sensors = scenario.sensors
    if not isinstance(sensors.errors, SensorTolerance):
        return []
    true, declared = msgspec.to_builtins(sensors.errors), msgspec.to_builtins(sensors.tolerance)
    larger = [
        f"{key} = {value:g} (tolerance {declared[key]:g})" for key, value in true.items() if value > declared[key]
    ]
    found = []
    if larger:
        found.append(
            f"'sensors.errors' has {few(larger, _MOST_NAMED)}: sensors are further off than 'sensors.tolerance' tells "
            f"the robots, so their own std will be too small. Give both the same values, or leave out 'errors'"
        )
    if sensors.drift.is_any:
        found.append(
            "'sensors.drift' is told to the robots, but with 'sensors.errors' in numbers nothing drifts: leave one out"
        )
    return found


def _exact_method(scenario: Scenario) -> list[str]:
    if "fan2017" not in estimator_names(scenario.estimator):
        return []
    kinds = [
        *(["sensor errors"] if scenario.sensors.tolerance != SensorTolerance() else []),
        *(["drift"] if scenario.sensors.drift.is_any else []),
        *(["correlated noise"] if scenario.sensors.noise_correlation > 0.0 else []),
        *(["robots that differ"] if scenario.sensors.of else []),
    ]
    if not kinds:
        return []
    return [
        f"'estimator' = 'fan2017' models only white noise, but 'sensors' has {' and '.join(kinds)}: robots will not "
        "report the payload, because they cannot know their errors. 'efficient' models all of this"
    ]


def _never(scenario: Scenario) -> list[str]:
    """Note changes of the load or of grasps after the end."""
    late = [f"'{key}' at {at:g} s" for key, at in late_changes(scenario)]
    if not late:
        return []
    return [f"the run ends at 'duration' = {scenario.duration:g} s, before {few(late, _MOST_NAMED)} would take effect"]

"""Notes about valid settings that contradict each other, and may not be intended: printed before a run."""

from collections.abc import Iterator

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


def notes(scenario: Scenario) -> Iterator[str]:
    """Yield a sentence for each contradiction between settings of a valid scenario; usually none."""
    sensors = scenario.sensors
    if isinstance(sensors.errors, SensorTolerance):
        true, declared = msgspec.to_builtins(sensors.errors), msgspec.to_builtins(sensors.tolerance)
        larger = [key for key, value in true.items() if value > declared[key]]
        if larger:
            found = [f"{key} = {true[key]:g} (tolerance {declared[key]:g})" for key in larger]
            yield (
                f"'sensors.errors' has {few(found, _MOST_NAMED)}: sensors are further off than 'sensors.tolerance', "
                f"one standard deviation of each error, tells the robots, so their own std will be too small. Give "
                f"both the same values, or leave out 'errors'"
            )
        if sensors.drift.is_any:
            yield (
                "'sensors.drift' is told to the robots, but with 'sensors.errors' in numbers nothing drifts: leave one "
                "out"
            )
    not_modelled = {
        "sensor errors": sensors.tolerance != SensorTolerance(),
        "drift": sensors.drift.is_any,
        "correlated noise": sensors.noise_correlation > 0.0,
        "robots that differ": bool(sensors.of),
    }
    if "fan2017" in estimator_names(scenario.estimator) and any(not_modelled.values()):
        kinds = " and ".join(kind for kind, is_there in not_modelled.items() if is_there)
        yield (
            f"'estimator' = 'fan2017' models only white noise, but 'sensors' has {kinds}: robots will not report the "
            f"payload, because they cannot know their errors. 'efficient' models all of this; with --set "
            f"'sensors.tolerance={{}}' sensors are exact"
        )
    if late := [f"'{key}' at {at:g} s" for key, at in late_changes(scenario)]:
        yield (
            f"the run ends at 'duration' = {scenario.duration:g} s, before {few(late, _MOST_NAMED)} would take effect"
        )

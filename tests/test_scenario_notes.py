"""Settings that contradict each other are named before a run."""

from __future__ import annotations

import msgspec
import pytest

from coheft.app.terminal.notes import notes
from coheft.wire.scenario.file import available_scenarios, load_scenario


@pytest.mark.parametrize("name", sorted(available_scenarios()))
def test_shipped_scenarios_mean_what_they_say(name: str) -> None:
    assert list(notes(load_scenario(name))) == []


@pytest.mark.parametrize(
    ("values", "told"),
    [
        (
            ["sensors.errors={force_offset=2.0}"],
            "'sensors.errors' has force_offset = 2 (tolerance 0): sensors are further off than 'sensors.tolerance', "
            "one standard deviation of each error, tells the robots",
        ),
        (
            ["sensors.errors={force_offset=2.0}", "sensors.tolerance={force_offset=1.0}"],
            "force_offset = 2 (tolerance 1)",
        ),
        (
            ["sensors.errors={force_offset=1,torque_offset=1,gyro_offset=1,velocity_offset=1,clock=1}"],
            "and 2 more: sensors are further off",
        ),
        (["sensors.errors='none'", "sensors.drift={force=0.1}"], None),
        (["sensors.errors={}", "sensors.drift={force=0.1}"], "nothing drifts: leave one out"),
        (["estimator='fan2017'"], None),
        (
            ["estimator='fan2017'", "sensors.tolerance={force_offset=1.0}", "sensors.noise_correlation=0.01"],
            "models only white noise, but 'sensors' has sensor errors and correlated noise",
        ),
        (["load_changes=[{at=5.0,mass=1.0}]", "duration=30.0"], None),
    ],
)
def test_what_contradicts_each_other_is_named(values: list[str], told: str | None) -> None:
    found = list(notes(load_scenario("ring3", values)))
    assert len(found) == (told is not None)
    assert told is None or told in found[0]


@pytest.mark.parametrize("at", [4.99, 5.0, 7.0])
def test_changes_that_never_come_are_named(at: float) -> None:
    """The last block begins at 4.98 s."""
    values = [f"load_changes=[{{at={at},mass=1.0}}]", f"slips=[{{at={at},robot='r1',rotation_deg=[1,0,0]}}]"]
    scenario = msgspec.structs.replace(load_scenario("ring3", values), duration=5.0)
    assert list(notes(scenario)) == [
        f"the run ends at 'duration' = 5 s, before 'load_changes[0]' at {at:g} s, 'slips[0]' at {at:g} s would take "
        "effect"
    ]
    assert list(notes(msgspec.structs.replace(scenario, duration=at + 0.1))) == []

"""Sensors whose offsets wander, as robots are told."""

from __future__ import annotations

import msgspec
import pytest

from coheft.app.run.inprocess import run_in_process
from coheft.estimation.tolerance import SensorDrift
from coheft.wire.messages.structs import Estimate
from coheft.wire.scenario.file import load_scenario


def estimates(drift: SensorDrift, seed: int, duration: float) -> list[Estimate]:
    """What the first of three robots says."""
    shipped = load_scenario("real3")
    sensors = msgspec.structs.replace(shipped.sensors, drift=drift)
    scenario = msgspec.structs.replace(shipped, seed=seed, duration=duration, load_changes=(), sensors=sensors)
    return [record.estimates["r1"] for record in run_in_process(scenario) if "r1" in record.estimates]


def test_forces_that_wander_far_are_not_taken_for_another_load() -> None:
    assert estimates(SensorDrift(force=1.0), 605, 14.0)[-1].load_changes == []


@pytest.mark.slow
def test_what_wanders_is_no_contradiction() -> None:
    found = estimates(SensorDrift(force=0.3, acceleration=0.02), 602, 40.0)
    assert found[-1].load_changes == []
    late = [estimate.status == "valid" for estimate in found if estimate.time > 5.0]
    assert sum(late) / len(late) > 0.95
    payload = found[-1].payload
    assert payload is not None
    assert payload.covariance[0, 0] ** 0.5 < 0.05
    assert abs(payload.mass - 5.0) < 0.1


def test_a_gyro_that_wanders_fast_does_not_contradict_the_others() -> None:
    found = estimates(SensorDrift(gyro=0.024), 603, 9.0)
    late = [estimate.status == "valid" for estimate in found if estimate.time > 4.0]
    assert sum(late) / len(late) > 0.9

"""Sensors whose offsets wander, as robots are told."""

from __future__ import annotations

import msgspec
import pytest

from coheft.app.run.inprocess import run_in_process
from coheft.estimation.tolerance import SensorDrift
from coheft.wire.scenario.file import load_scenario


@pytest.mark.slow
def test_what_wanders_is_neither_another_load_nor_a_contradiction() -> None:
    shipped = load_scenario("real3")
    sensors = msgspec.structs.replace(shipped.sensors, drift=SensorDrift(force=0.3, acceleration=0.02))
    scenario = msgspec.structs.replace(shipped, seed=602, duration=40.0, load_changes=(), sensors=sensors)
    found = [record.estimates["r1"] for record in run_in_process(scenario) if "r1" in record.estimates]
    assert found[-1].load_changes == []
    late = [estimate.status == "valid" for estimate in found if estimate.time > 5.0]
    assert sum(late) / len(late) > 0.95
    payload = found[-1].payload
    assert payload is not None
    assert payload.covariance[0, 0] ** 0.5 < 0.05
    assert abs(payload.mass - 5.0) < 0.1

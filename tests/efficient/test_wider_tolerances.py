"""Robots whose sensors are worse than they are told."""

from __future__ import annotations

import msgspec
import pytest

from coheft.agents.efficient import session
from coheft.app.faults.invariants import Watch
from coheft.app.faults.run import FaultyRun
from coheft.app.faults.schedule import FaultSchedule
from coheft.estimation.tolerance import INDUSTRIAL, SensorTolerance
from coheft.wire.scenario.file import load_scenario

TOLD = SensorTolerance(**{key: size / 3.0 for key, size in msgspec.structs.asdict(INDUSTRIAL).items()})


def share_valid(seed: int, after: float) -> float:
    """Share of reports that are valid if all sensors are three times worse than told; valid numbers must be right."""
    scenario = load_scenario("real3", ["duration=8", f"seed={seed}", "load_changes=[]"])
    sensors = msgspec.structs.replace(scenario.sensors, tolerance=TOLD, errors=INDUSTRIAL)
    scenario = msgspec.structs.replace(scenario, sensors=sensors)
    schedule = FaultSchedule(seed=seed, scenario=scenario, faults=())
    run, valid = FaultyRun(schedule), list[bool]()
    watch = Watch(schedule, run.scene)
    for block in run:
        watch.look(block)
        estimates = [outbox.estimate for outbox in block.outboxes.values() if outbox.estimate is not None]
        valid += [estimate.status == "valid" for estimate in estimates if estimate.time > after]
        for estimate in estimates:
            for error in estimate.sensor_errors:
                if error.key == "acceleration_offset":
                    assert error.told == pytest.approx(INDUSTRIAL.acceleration_offset / 3.0)
    assert watch.violations == []
    return sum(valid) / len(valid)


@pytest.mark.slow
def test_tolerances_that_are_too_small_grow(monkeypatch: pytest.MonkeyPatch) -> None:
    assert share_valid(9102, 6.0) == 1.0
    monkeypatch.setattr(session, "widened", lambda *_: None)
    assert share_valid(9102, 6.0) == 0.0

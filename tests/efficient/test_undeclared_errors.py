"""Robots that take sensors to be exact, though they are not."""

from __future__ import annotations

from collections import Counter
from functools import partial

import msgspec
import pytest

from coheft.agents.efficient import estimator
from coheft.agents.efficient.settings import Guards
from coheft.app.run.inprocess import run_in_process
from coheft.estimation.tolerance import SensorTolerance
from coheft.wire.messages.structs import Estimate
from coheft.wire.scenario.file import load_scenario


def estimates(duration: float, **errors: float) -> list[Estimate]:
    """What the first of three robots says, whose sensors are declared to be exact."""
    shipped = load_scenario("ring3")
    sensors = msgspec.structs.replace(
        shipped.sensors, rate=500, block=10, tolerance=SensorTolerance(), errors=SensorTolerance(**errors)
    )
    scenario = msgspec.structs.replace(shipped, seed=7000, duration=duration, load_changes=(), sensors=sensors)
    return [record.estimates["r1"] for record in run_in_process(scenario) if "r1" in record.estimates]


def share_valid(found: list[Estimate], after: float) -> float:
    late = [estimate.status == "valid" for estimate in found if estimate.time > after]
    return sum(late) / len(late)


def test_a_small_scale_that_no_one_told_of_is_named_and_nothing_holds() -> None:
    found = estimates(14.0, acceleration_scale=0.0033)
    assert share_valid(found, 8.0) < 0.2  # all the time without the look for undeclared errors
    reasons = Counter(reason for estimate in found if estimate.time > 8.0 for reason in estimate.reasons)
    assert "seems to have another scale, but is declared to be exact" in reasons.most_common(1)[0][0]
    assert reasons.most_common(1)[0][0].startswith("the accelerometer of ")


@pytest.mark.slow
def test_sensors_that_are_exact_are_not_named() -> None:
    found = estimates(40.0)
    assert share_valid(found, 2.0) == 1.0


@pytest.mark.slow
def test_without_this_guard_it_would_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimator, "Guards", partial(Guards, undeclared=1e-300))
    assert share_valid(estimates(14.0, acceleration_scale=0.0033), 8.0) > 0.5

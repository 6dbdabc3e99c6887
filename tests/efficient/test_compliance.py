"""Robots whose hands move against the load by what they push."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
import pytest

from coheft.app.results.judge import Judge
from coheft.app.run.inprocess import TeamInProcess, measured
from coheft.estimation.tolerance import SensorTolerance
from coheft.wire.messages.structs import Estimate
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import Scenario

GIVES = 6e-5
"""Compliance [m/N]."""


def scenario(told: float, duration: float, *, changes: bool = False) -> Scenario:
    shipped = load_scenario("ring3")
    sensors = msgspec.structs.replace(
        shipped.sensors,
        tolerance=SensorTolerance(grasp_compliance=told),
        errors=SensorTolerance(grasp_compliance=GIVES),
    )
    load_changes = tuple(msgspec.structs.replace(each, at=6.0) for each in shipped.load_changes) if changes else ()
    return msgspec.structs.replace(shipped, seed=42, duration=duration, sensors=sensors, load_changes=load_changes)


def estimates(chosen: Scenario) -> Iterator[tuple[Estimate, bool]]:
    """What all robots say, and whether it is valid and right."""
    team = TeamInProcess(chosen)
    judge = Judge(team.simulation.scene)
    for _ in range(chosen.blocks):
        result = team.measure()
        judge.add(result.truth, remember=chosen.blocks)
        for outbox in team.answer(measured(result), team.received()).values():
            if (said := outbox.estimate) is not None:
                at = msgspec.structs.replace(said, block=max(said.valid_block, 0))
                yield said, said.status == "valid" and not judge.contradictions(at)


def test_robots_that_are_told_of_it_are_right_and_others_are_not() -> None:
    for told, expected in ((GIVES, True), (0.0, False)):
        found = [is_right for said, is_right in estimates(scenario(told, 8.0)) if said.time > 5.0]
        assert len(found) > 80
        assert (sum(found) / len(found) > 0.99) if expected else (sum(found) / len(found) < 0.05)


@pytest.mark.slow
def test_a_load_change_is_noticed_once_and_named_no_fault() -> None:
    last = dict[str, Estimate]()
    for said, is_right in estimates(scenario(GIVES, 9.0, changes=True)):
        last[said.robot] = said
        assert is_right or said.time < 3.0 or 6.0 < said.time < 6.7
        assert not any("contradict" in reason for reason in said.reasons)
    for said in last.values():
        (notice,) = said.load_changes
        assert 6.0 < notice.noticed_at < 6.4
        assert said.slips == []

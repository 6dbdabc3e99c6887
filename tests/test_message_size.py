"""What neighbours say fits into the messages that they take."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from coheft.agents.agent import ESTIMATORS
from coheft.app.faults.run import FaultyRun
from coheft.app.faults.schedule import Crash, FaultSchedule
from coheft.wire.messages.codec import encode
from coheft.wire.messages.limits import PER_MESSAGE
from coheft.wire.messages.size import (
    ARRAYS,
    LARGEST,
    LEAST_LIMIT,
    largest_arrays,
    largest_message,
    message_limit,
)
from coheft.wire.messages.structs import LinkState, NeighbourMessage
from coheft.wire.scenario.estimator_settings import Fan2017Settings
from coheft.wire.scenario.plugins import BUILT_IN
from coheft.wire.scenario.schema import Graph, Scenario
from tests.in_process import changed, steps


def largest_found(scenario: Scenario) -> int:
    return max(len(encode(outbox.message, "key")) for _, outboxes in steps(scenario) for outbox in outboxes.values())


def test_it_is_known_of_all_estimators_what_they_send() -> None:
    assert set(ARRAYS) == set(BUILT_IN["estimator"]) == set(ESTIMATORS)


@pytest.mark.parametrize("name", ["line4", "ring6"])
def test_rows_of_all_robots_and_what_a_newcomer_is_told_fit(name: str) -> None:
    scenario = changed(name, load_changes=(), duration=3.0)
    again = FaultyRun(FaultSchedule(seed=1, scenario=scenario, faults=(Crash(robot="r1", start=2.0, end=2.4),)))
    found = max(len(encode(outbox.message, "key")) for block in again for outbox in block.outboxes.values())
    assert 0.3 * ARRAYS["efficient"](scenario) < found <= largest_message(scenario)


def test_dynamic_consensus_fits() -> None:
    scenario = changed(
        "ring3",
        load_changes=(),
        duration=20.0,
        estimator="fan2017",
        graph=Graph(kind="line"),
        fan2017=Fan2017Settings(rounds=64, pose_rotation_deg=1.0, pose_translation_mm=20.0),
    )
    sensors = msgspec.structs.replace(scenario.sensors, block=100)
    scenario = msgspec.structs.replace(scenario, sensors=sensors)
    found = largest_found(scenario)
    assert 0.8 * largest_message(scenario) < found <= largest_message(scenario)


def test_neighbours_take_messages_of_every_estimator_that_the_run_can_come_to_use() -> None:
    scenario = changed("ring3", fan2017=Fan2017Settings(rounds=100))
    sensors = msgspec.structs.replace(scenario.sensors, block=100)
    scenario = msgspec.structs.replace(scenario, sensors=sensors)
    other = msgspec.structs.replace(scenario, estimator="fan2017")
    assert largest_message(scenario) < LEAST_LIMIT < largest_message(other) <= message_limit(scenario) <= LARGEST


@pytest.mark.parametrize("name", ["ring3", "ring24", "grid48"])
def test_the_largest_arrays_of_an_own_estimator_fit_beside_all_that_is_told_of_robots(name: str) -> None:
    scenario = changed(name)
    names = scenario.robot_names
    records = [LinkState(name, 2**60, names, 2**60, 2**60, True, 2**60, 2**31) for name in names[:PER_MESSAGE]]
    channels = {"all": np.zeros(largest_arrays(scenario) // 8)}
    message = NeighbourMessage(sender="r1", block=2**60, gossip=records, channels=channels, incarnation=2**60)
    assert len(encode(message, "key")) <= message_limit(scenario)

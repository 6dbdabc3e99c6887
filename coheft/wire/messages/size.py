"""How large the messages between neighbours can become: what is larger is no message of the run, and is dropped unread.

Rows of all robots, or numbers under way in the network's sums, make up nearly all of it. Of what all robots tell each
other about themselves, a message holds so many lines at most, each with the names of a robot's neighbours.
"""

from __future__ import annotations

from collections.abc import Callable

from msgspec import structs

from coheft.estimation.measurement import KINEMATICS_SIZE
from coheft.estimation.moments.rows import rows_per_block
from coheft.estimation.moments.sensor_errors import SensorErrors
from coheft.wire.scenario.plugins import BUILT_IN
from coheft.wire.scenario.schema import Scenario

LEAST_LIMIT = 256 * 1024
"""Limit for all other messages, and for those of neighbours where these are smaller [B]."""
LARGEST = 4_000_000
"""What a scenario may need [B]: two messages of one neighbour must find room in the inbox."""
MANY = 64
"""In larger teams exact sums go up a tree and down again: all rounds but two stay with the robots."""
PER_MESSAGE = 32
"""Of what all robots tell each other, so many lines at most travel in a message."""
MOST_TOLD = 450
"""With more unknowns than these a robot that is new is not told what is known: it would take megabytes."""
_NUMBER, _LABEL, _NUMBER_OF_ROW = 8, 8, 4
"""A number of the consensus; the label of a row, and one of its numbers [B]."""
_PER_LINE = 4096
"""For a robot's line in gossip and in the tables that are handed on [B]."""
_PER_NAME = 40
"""For a neighbour's name in such a line [B]."""
_REST = 65536


def _of_rows(scenario: Scenario) -> int:
    """Rows of all robots that are told twice, as many again that come late, and what a newcomer is told [B]."""
    rows = rows_per_block(scenario.sensors.block, scenario.sensors.rate)  # as many or, in large teams, fewer
    errors = SensorErrors.of(scenario.sensors.tolerance, scenario.sensors.drift)
    unknowns = min((6 + errors.count) * scenario.robot_count + 19, MOST_TOLD)
    row = _LABEL + _NUMBER_OF_ROW * (errors.width - 1)
    return 4 * scenario.robot_count * rows * row + _NUMBER * (unknowns**2 + 8 * unknowns)


def _of_consensus(scenario: Scenario) -> int:
    """Wrench, angular acceleration and whether both are measured, for each sample and round; and the samples [B]."""
    per_sample = scenario.fan2017.rounds * 10 + KINEMATICS_SIZE
    return _NUMBER * scenario.sensors.block * per_sample


ARRAYS: dict[str, Callable[[Scenario], int]] = {"efficient": _of_rows, "fan2017": _of_consensus}
"""By estimator that comes with coheft, what its arrays need [B]."""


def largest_message(scenario: Scenario) -> int:
    """No message between neighbours is larger [B]; an estimator of the user's own has as much room as ``efficient``."""
    arrays = ARRAYS[scenario.estimator if scenario.estimator in BUILT_IN["estimator"] else "efficient"]
    return arrays(scenario) + _besides_arrays(scenario)


def message_limit(scenario: Scenario) -> int:
    """What neighbours may send in one message, whichever estimator the run comes to use [B]."""
    needed = [largest_message(structs.replace(scenario, estimator=name)) for name in BUILT_IN["estimator"]]
    return max(LEAST_LIMIT, min(max(needed), LARGEST))


def largest_arrays(scenario: Scenario) -> int:
    """What an estimator of the user's own may send in one message [B]: all that the rest of it does not need."""
    return message_limit(scenario) - _besides_arrays(scenario)


def _besides_arrays(scenario: Scenario) -> int:
    """What else a message may hold [B]."""
    lines = min(scenario.robot_count, PER_MESSAGE) * (_PER_LINE + _PER_NAME * scenario.robot_count)
    return lines + _REST

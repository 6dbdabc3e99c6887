"""How large the messages between neighbours can become: what is larger is no message of the run, and is dropped unread.

Numbers under way in the network's sums make up nearly all of it: as many blocks as the sums have rounds, in large teams
two. Of what all robots tell each other, a message holds so many lines at most, each with the names of a robot's
neighbours.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from msgspec import structs

from coheft.estimation.measurement import KINEMATICS_SIZE
from coheft.wire.plugins import BUILT_IN
from coheft.wire.scenario import Scenario

LEAST_LIMIT = 256 * 1024
"""Limit for all other messages, and for those of neighbours where these are smaller [B]."""
LARGEST = 4_000_000
"""What a scenario may need [B]: two messages of one neighbour must find room in the inbox."""
MANY = 64
"""Teams of more robots take sums up a tree and down again: all rounds but two stay with the robots."""
PER_MESSAGE = 32
"""Of what all robots tell each other, so many lines at most travel in a message."""
_NUMBER = 8
_PER_LINE = 4096
"""For a robot's line in gossip and in the tables that are handed on [B]."""
_PER_NAME = 40
"""For a neighbour's name in such a line [B]."""
_REST = 65536


class Sums(NamedTuple):
    """What an estimator's sums put into a message.

    Attributes:
        numbers: Per sample of a block under way.
        rounds: How many blocks are under way, at most.
    """

    numbers: int
    rounds: Callable[[Scenario], int]


SUMS = {
    # Summands of the present, and of two samples of before the start. Exact sums take at most N rounds on any graph.
    "efficient": Sums(3 * 18, lambda scenario: min(scenario.robot_count, MANY)),
    # Rows of all robots, twice, are fewer numbers than these.
    "moments": Sums(3 * 18, lambda scenario: min(scenario.robot_count, MANY)),
    # Wrench, angular acceleration, and whether both are measured.
    "seed": Sums(10, lambda scenario: scenario.seed_method.rounds),
}
"""By estimator that comes with coheft."""


def largest_message(scenario: Scenario) -> int:
    """No message between neighbours is larger [B]; an estimator of the user's own has as much room as ``efficient``."""
    sums = SUMS[scenario.estimator if scenario.estimator in BUILT_IN["estimator"] else "efficient"]
    samples = scenario.sensors.block * (sums.rounds(scenario) * sums.numbers + KINEMATICS_SIZE)
    return _NUMBER * samples + _besides_sums(scenario)


def message_limit(scenario: Scenario) -> int:
    """What neighbours may send in one message, whichever estimator the run comes to use [B]."""
    needed = [largest_message(structs.replace(scenario, estimator=name)) for name in BUILT_IN["estimator"]]
    return max(LEAST_LIMIT, min(max(needed), LARGEST))


def largest_arrays(scenario: Scenario) -> int:
    """What an estimator of the user's own may send in one message [B]: all that the rest of it does not need."""
    return message_limit(scenario) - _besides_sums(scenario)


def _besides_sums(scenario: Scenario) -> int:
    """What else a message may hold [B]."""
    lines = min(scenario.robot_count, PER_MESSAGE) * (_PER_LINE + _PER_NAME * scenario.robot_count)
    return lines + _REST

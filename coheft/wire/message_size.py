"""How large the messages between neighbours can become: what is larger is no message of the run, and is dropped unread.

Numbers under way in the network's sums make up nearly all of it: as many blocks as the sums have rounds.
"""

from __future__ import annotations

from coheft.wire.scenario import Scenario

LEAST_LIMIT = 256 * 1024
"""Limit for all other messages, and for those of neighbours where these are smaller [B]."""
LARGEST = 4_000_000
"""What a scenario may need [B]: two messages of one neighbour must find room in the inbox."""
_NUMBER = 8
_SEED_NUMBERS = 10
"""Per sample in the sums of the estimator ``seed``: wrench, angular acceleration, and whether both are measured."""
_EFFICIENT_NUMBERS = 2 * 18
"""Per sample in those of ``efficient``: its summands twice, because the first samples are summed again meanwhile."""
_KINEMATICS = 9
_PER_ROBOT = 4096
"""For a robot's line in gossip and in the tables that are handed on [B]."""
_REST = 65536


def largest_message(scenario: Scenario) -> int:
    """No message between neighbours is larger [B].

    Exact sums over N robots take at most N rounds, up a tree and down again, whatever the graph.
    """
    if scenario.estimator == "seed":
        rounds, numbers = scenario.seed_method.rounds, _SEED_NUMBERS
    else:
        rounds, numbers = scenario.robot_count, _EFFICIENT_NUMBERS
    samples = scenario.sensors.block * (rounds * numbers + _KINEMATICS)
    return _NUMBER * samples + _PER_ROBOT * scenario.robot_count + _REST


def message_limit(scenario: Scenario) -> int:
    """What neighbours may send in one message [B]."""
    return max(LEAST_LIMIT, largest_message(scenario))

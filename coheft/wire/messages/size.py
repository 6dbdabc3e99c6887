"""Size limits of the messages between neighbours; larger messages are dropped unread.

Nearly all of a message are rows of all robots, or numbers in progress of the network's sums. A message holds a limited
number of the robots' records, each with the names of the robot's neighbours.
"""

from collections.abc import Callable

from msgspec import structs

from coheft.estimation.measurement import KINEMATICS_SIZE
from coheft.estimation.moments.rows import rows_per_block
from coheft.estimation.moments.sensor_errors import SensorErrors
from coheft.wire.messages.limits import PER_MESSAGE
from coheft.wire.scenario.plugins import BUILT_IN, estimator_names
from coheft.wire.scenario.schema import Scenario

LEAST_LIMIT = 256 * 1024
"""Limit for all other messages, and for those of neighbours if these are smaller [B]."""
LARGEST = 4_000_000
"""Largest limit that a scenario may need [B]: two messages of one neighbour have to fit into the inbox."""
MOST_HANDED_OVER = 450
"""With more unknowns, a robot that joins does not receive the team's estimate, which would take megabytes."""
MOST_SEALED = 50
"""Largest number of a robot's rows in a seal."""
# Sizes [B]:
_PER_SEAL = 512  # see ``coheft.agents.efficient.seals``
_NUMBER, _LABEL, _NUMBER_OF_ROW = 8, 8, 4  # of the consensus, of a row, and one of the row's numbers
_PER_RECORD = 4096  # a robot's, in gossip
_PER_NAME = 40  # a neighbour's, in such a record
_REST = 65536


def _row_arrays(scenario: Scenario) -> int:
    """Return the size of all robots' rows, sent twice, late rows, seals, and the estimate for a new robot [B]."""
    rows = rows_per_block(scenario.sensors.block, scenario.sensors.rate)  # as many or, in large teams, fewer
    sheets = [scenario.sensors.tolerance, *(each.tolerance for each in scenario.robot_sensors())]
    errors = SensorErrors.of(sheets, scenario.sensors.drift)
    unknowns = min((6 + errors.count) * scenario.robot_count + 19, MOST_HANDED_OVER)
    row = _LABEL + _NUMBER_OF_ROW * (errors.width - 1)
    seals = (2 * scenario.robot_count + 1) * _PER_SEAL
    return 4 * scenario.robot_count * rows * row + seals + _NUMBER * (unknowns**2 + 8 * unknowns)


def _consensus_arrays(scenario: Scenario) -> int:
    """Return the size of wrench, angular acceleration and validity for each sample and round, of the samples, of what a
    block does to the estimate for each round, and of the estimate [B].
    """
    rounds = scenario.fan2017.rounds
    return _NUMBER * (scenario.sensors.block * (rounds * 10 + KINEMATICS_SIZE) + rounds * 11 + 131)


ARRAYS: dict[str, Callable[[Scenario], int]] = {"efficient": _row_arrays, "fan2017": _consensus_arrays}
"""Size of the arrays of each estimator that comes with coheft [B]."""


def largest_message(scenario: Scenario) -> int:
    """Return the size of the largest message between neighbours [B]; a user's estimator has the limit of
    ``efficient``. Estimators that run side by side share the messages.
    """
    arrays = sum(ARRAYS.get(name, _row_arrays)(scenario) for name in estimator_names(scenario.estimator))
    return arrays + _besides_arrays(scenario)


def message_limit(scenario: Scenario) -> int:
    """Return the limit of messages between neighbours, whichever estimator is used during the run [B]."""
    names = (*BUILT_IN["estimator"], scenario.estimator)
    needed = [largest_message(structs.replace(scenario, estimator=name)) for name in names]
    return max(LEAST_LIMIT, min(max(needed), LARGEST))


def largest_arrays(scenario: Scenario) -> int:
    """Return the size that a user's estimator may send in one message [B]: the limit minus all other content."""
    return message_limit(scenario) - _besides_arrays(scenario)


def _besides_arrays(scenario: Scenario) -> int:
    lines = min(scenario.robot_count, PER_MESSAGE) * (_PER_RECORD + _PER_NAME * scenario.robot_count)
    return lines + _REST

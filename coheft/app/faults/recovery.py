"""P3: some time after the last fault has ended and the load has changed for the last time, every robot is valid again.

How long that may take depends on what happened; the first line that is true counts. ``tellings`` is how long what one
robot tells needs to reach all others, ``_TELLINGS`` times. Faults count that were over less than ``FIND_OUT`` and
``tellings`` before everything was.

======================================================  =======================  =====================================
What happened                                           Time allowed             Why
======================================================  =======================  =====================================
not all were valid before the first fault began, or     ``START_UP + tellings``  how long a start takes depends on how
there was no fault                                                               they move
a robot took hold again, or was dead at the same time   ``FIND_OUT + tellings``  it has to find out where it holds the
as all its neighbours                                                            load, and no robot can tell it
faults, all of them crashes and partitions              ``BACK_FROM_SILENCE``    no estimate was contaminated
other faults, or changes of the load alone              ``BACK``                 contaminated rows are dropped first
======================================================  =======================  =====================================
"""

from __future__ import annotations

from coheft.app.faults.hands import Hands
from coheft.app.faults.invariants import Violation
from coheft.app.faults.run import FaultyBlock
from coheft.app.faults.schedule import Crash, FaultSchedule, Lie, Partition, Release
from coheft.consensus.graph import build_graph, diameter
from coheft.wire.messages.structs import Estimate
from coheft.wire.scenario.schema import LoadChange

BACK_FROM_SILENCE = 3.0
"""Time until every robot is valid again after crashes and partitions [s]."""
BACK = 5.0
"""Time until every robot is valid again after other faults, and after changes of the load [s]."""
FIND_OUT = 4.0
"""Time until every robot is valid again if one has to find out where it holds the load, without ``tellings`` [s]."""
START_UP = 6.0
"""Time until every robot is valid again if they had not all been valid before, without ``tellings`` [s]."""
_TELLINGS = 15
"""``tellings`` are so many times as long as what one robot tells needs to reach all others."""
_LASTING = 1.0
"""Who is valid for a shorter time may not have noticed yet what is wrong [s]."""
_STEADY = 2.5
"""Once nothing happens any more, and all have been valid for so long, nothing new is to be seen [s]."""
_ROUNDING = 1e-9


def latest_recovery(schedule: FaultSchedule) -> float:
    """When every robot has to be valid again at the latest [s], whatever has been at work."""
    return _calm_from(schedule) + START_UP + _tellings(schedule)


def _calm_from(schedule: FaultSchedule) -> float:
    """From when on nothing happens any more [s]."""
    return max([schedule.last_fault_end, *(_end_of(change) for change in schedule.scenario.load_changes)])


def _end_of(change: LoadChange) -> float:
    """When a change of the load is over [s]: a load that leaks goes on changing until nothing is left."""
    return change.at + (change.mass or 0.0) / change.leak if change.leak > 0.0 else change.at


def _tellings(schedule: FaultSchedule) -> float:
    """Time for all that robots have to tell each other where nothing was known before [s]."""
    scenario = schedule.scenario
    graph = build_graph(scenario.graph, scenario.robot_names)
    return _TELLINGS * (diameter(graph) + 1) * scenario.block_duration


class Recovery:
    """Follows who is valid. Only those are asked who hold the load at the end, and never lie.

    Attributes:
        first_valid: When all were valid for the first time [s]; None if never.
        stale: Number of published estimates that were stale.
        published: Number of all published estimates.
    """

    def __init__(self, schedule: FaultSchedule) -> None:
        scenario = schedule.scenario
        self._schedule = schedule
        liars = {fault.robot for fault in schedule.faults if isinstance(fault, Lie)}
        self._graph = build_graph(scenario.graph, scenario.robot_names)
        self._tellings, self._calm_from = _tellings(schedule), _calm_from(schedule)
        last = scenario.blocks - 1
        self._asked = [n for n in scenario.robot_names if n not in liars and Hands(schedule, n).holds(last)]
        self._latest: dict[str, Estimate] = {}
        self.first_valid: float | None = None
        self._valid_since: float | None = None
        self._recovered_at: float | None = None
        self._now = 0.0
        self.stale = self.published = 0

    def look(self, block: FaultyBlock) -> None:
        """Take in what was published after a block."""
        for robot, outbox in block.outboxes.items():
            if outbox.estimate is not None:
                self._latest[robot] = outbox.estimate
                self.published += 1
                self.stale += outbox.estimate.status == "stale"
        for robot in [name for name in self._latest if name not in block.outboxes]:
            del self._latest[robot]
        self._now = block.truth.time
        if not all(self._is_valid(name) for name in self._asked):
            self._valid_since = None
        elif self._valid_since is None:
            self._valid_since = self._now
            self.first_valid = self._now if self.first_valid is None else self.first_valid
        if self._recovered_at is None and self._valid_for >= _LASTING - _ROUNDING:
            self._recovered_at = self._now - self._valid_for

    @property
    def _valid_for(self) -> float:
        """For how long all have been valid, and nothing has happened [s]."""
        return 0.0 if self._valid_since is None else self._now - max(self._valid_since, self._calm_from)

    @property
    def is_steady(self) -> bool:
        """Whether nothing has happened for long, and all have been valid."""
        return self._valid_for >= _STEADY - _ROUNDING

    @property
    def taken(self) -> float | None:
        """Time from the last fault's end to all being valid, and not for a moment only [s]; None if they are not."""
        if self._recovered_at is not None:
            return self._recovered_at - self._calm_from
        return None if self._valid_since is None else max(0.0, self._valid_since - self._calm_from)

    def violation(self) -> Violation | None:
        """Whether it took too long, or never ended; None also if the run was too short to tell."""
        limit, must_find_out = self._limit()
        calm, taken = self._calm_from, self.taken
        if calm + limit > self._schedule.scenario.duration - _ROUNDING and taken is None:
            return None
        if taken is not None and taken <= limit + _ROUNDING:
            return None
        if taken is None and must_find_out and all(self._sees_too_little(name) for name in self._asked):
            return None
        robot = next((name for name in self._asked if not self._is_valid(name)), "")
        reasons = "; ".join(self._latest[robot].reasons) if robot in self._latest else "silent"
        found = f"took {taken:.2f} s" if taken is not None else f"not at the end: {reasons}"
        return Violation("P3", calm + limit, robot, f"all valid within {limit:g} s: {found}", taken or 0.0)

    def _limit(self) -> tuple[float, bool]:
        """Time that it may take [s], and whether a robot has to find out where it holds the load."""
        find_out = FIND_OUT + self._tellings
        last = [fault for fault in self._schedule.faults if fault.end > self._calm_from - find_out]
        crashes = [fault for fault in last if isinstance(fault, Crash)]
        first_fault = min((fault.start for fault in self._schedule.faults), default=0.0)
        if self.first_valid is None or self.first_valid > first_fault:
            return START_UP + self._tellings, True
        if self._nobody_knows(crashes) or any(isinstance(fault, Release) for fault in last):
            return find_out, True
        is_from_silence = bool(last) and all(isinstance(fault, Crash | Partition) for fault in last)
        return BACK_FROM_SILENCE if is_from_silence else BACK, False

    def _nobody_knows(self, crashes: list[Crash]) -> bool:
        """Whether a robot and all its neighbours have been dead at the same time."""
        for own in crashes:
            meanwhile = {other.robot for other in crashes if other.start <= own.end and own.start <= other.end}
            if meanwhile.issuperset(self._graph[own.robot]):
                return True
        return False

    def _is_valid(self, robot: str) -> bool:
        return robot in self._latest and self._latest[robot].status == "valid"

    def _sees_too_little(self, robot: str) -> bool:
        """Whether it is valid, or tells that the motion has not shown it enough, and has no other reason not to be."""
        estimate = self._latest.get(robot)
        if estimate is None or not estimate.not_observable:
            return self._is_valid(robot)
        return self._is_valid(robot) or set(estimate.reasons) == set(estimate.not_observable)

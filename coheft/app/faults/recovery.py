"""P3: some time after the last fault has ended and the load has changed for the last time, every robot is valid again.

The time allowed depends on what happened; the first line that applies counts. ``exchange`` is ``_MESSAGES`` times the
time until a message has reached all robots. Faults count if they ended less than ``FIND_OUT`` plus ``exchange`` before
the last event.

======================================================  =======================  =====================================
What happened                                           Time allowed             Why
======================================================  =======================  =====================================
not all were valid before the first fault began, or     ``START_UP + exchange``  the duration of a start depends on
there was no fault                                                               the motion
a robot slipped, grasped the load again, or was dead    ``FIND_OUT + exchange``  it has to find its grasp pose, which
together with all its neighbours                                                 no other robot knows
faults, all of them crashes and partitions              ``BACK_FROM_SILENCE``    no estimate was contaminated
other faults, or changes of the load alone              ``BACK``                 contaminated rows are dropped first
======================================================  =======================  =====================================
"""

from coheft.app.faults.grasp_schedule import GraspSchedule
from coheft.app.faults.invariants import Violation
from coheft.app.faults.run import FaultyBlock
from coheft.app.faults.schedule import Crash, FaultSchedule, Lie, Partition, Release
from coheft.consensus.graph import build_graph, diameter
from coheft.wire.messages.structs import Estimate, Validity

BACK_FROM_SILENCE = 3.0
"""Time until every robot is valid again after crashes and partitions [s]."""
BACK = 5.0
"""Time until every robot is valid again after other faults, and after changes of the load [s]."""
FIND_OUT = 4.0
"""Time until every robot is valid again if one has to find its grasp pose, without ``exchange`` [s]."""
START_UP = 6.0
"""Time until every robot is valid again if they had not all been valid before, without ``exchange`` [s]."""
_MESSAGES = 15
"""``exchange`` in units of the time until a message has reached all robots."""
_LASTING = 1.0
"""Shortest time of being valid that counts as recovery: a robot might not have noticed a problem yet [s]."""
_STEADY = 2.5
"""Time for which all have been valid without events, after which a run need not continue [s]."""
_ROUNDING = 1e-9


def latest_recovery(schedule: FaultSchedule) -> float:
    """Return the time at which every robot has to be valid again at the latest, whatever happened [s]."""
    return _last_event(schedule) + START_UP + _exchange_time(schedule)


def _last_event(schedule: FaultSchedule) -> float:
    scenario = schedule.scenario
    ends = [slip.at for slip in scenario.slips]
    for change in scenario.load_changes:  # a load that leaks changes until it is empty
        ends.append(change.at + (change.mass or 0.0) / change.leak if change.leak > 0.0 else change.at)
    return max([schedule.last_fault_end, *ends])


def _exchange_time(schedule: FaultSchedule) -> float:
    """Return the time for all messages that robots need to exchange if they start without knowledge [s]."""
    scenario = schedule.scenario
    graph = build_graph(scenario.graph, scenario.robot_names)
    return _MESSAGES * (diameter(graph) + 1) * scenario.block_duration


class Recovery:
    """Follows which robots are valid; all were so for the first time at ``first_valid`` [s].

    Only robots that hold the load at the end and never lie are considered.
    """

    def __init__(self, schedule: FaultSchedule) -> None:
        scenario = schedule.scenario
        self._schedule = schedule
        liars = {fault.robot for fault in schedule.faults if isinstance(fault, Lie)}
        self._graph = build_graph(scenario.graph, scenario.robot_names)
        self._exchange, self._last_event = _exchange_time(schedule), _last_event(schedule)
        last = scenario.blocks - 1
        self._considered = [
            n for n in scenario.robot_names if n not in liars and GraspSchedule(schedule, n).holds(last)
        ]
        self._latest: dict[str, Estimate] = {}
        self.first_valid: float | None = None
        self._valid_since: float | None = None
        self._recovered_at: float | None = None
        self._now = 0.0
        self.stale = self.published = 0

    def add(self, block: FaultyBlock) -> None:
        """Add the estimates that were published after a block."""
        for robot, outbox in block.outboxes.items():
            if outbox.estimate is not None:
                self._latest[robot] = outbox.estimate
                self.published += 1
                self.stale += outbox.estimate.status is Validity.STALE
        for robot in [name for name in self._latest if name not in block.outboxes]:
            del self._latest[robot]
        self._now = block.truth.time
        if not all(self._is_valid(name) for name in self._considered):
            self._valid_since = None
        elif self._valid_since is None:
            self._valid_since = self._now
            self.first_valid = self._now if self.first_valid is None else self.first_valid
        if self._recovered_at is None and self._valid_for >= _LASTING - _ROUNDING:
            self._recovered_at = self._now - self._valid_for

    @property
    def _valid_for(self) -> float:
        """Time for which all have been valid since the last event [s]."""
        return 0.0 if self._valid_since is None else self._now - max(self._valid_since, self._last_event)

    @property
    def is_steady(self) -> bool:
        """Whether all have been valid for long since the last event."""
        return self._valid_for >= _STEADY - _ROUNDING

    @property
    def taken(self) -> float | None:
        """Time from the last event until all were valid, not just for a moment [s]; None if they are not."""
        if self._recovered_at is not None:
            return self._recovered_at - self._last_event
        return None if self._valid_since is None else max(0.0, self._valid_since - self._last_event)

    def violation(self) -> Violation | None:
        """Return the violation, if recovery took too long or never came; None also if the run was too short to tell."""
        limit, must_find_out = self._limit()
        calm, taken = self._last_event, self.taken
        if calm + limit > self._schedule.scenario.duration - _ROUNDING and taken is None:
            return None
        if taken is not None and taken <= limit + _ROUNDING:
            return None
        if taken is None and must_find_out and all(self._lacks_motion(name) for name in self._considered):
            return None
        robot = next((name for name in self._considered if not self._is_valid(name)), "")
        reasons = "; ".join(self._latest[robot].reasons) if robot in self._latest else "silent"
        found = f"took {taken:.2f} s" if taken is not None else f"not at the end: {reasons}"
        return Violation("P3", calm + limit, robot, f"all valid within {limit:g} s: {found}", taken or 0.0)

    def _limit(self) -> tuple[float, bool]:
        """Return the time allowed [s], and whether a robot has to find its grasp pose."""
        find_out = FIND_OUT + self._exchange
        last = [fault for fault in self._schedule.faults if fault.end > self._last_event - find_out]
        crashes = [fault for fault in last if isinstance(fault, Crash)]
        first_fault = min((fault.start for fault in self._schedule.faults), default=0.0)
        if self.first_valid is None or self.first_valid > first_fault:
            return START_UP + self._exchange, True
        has_slipped = any(slip.at > self._last_event - find_out for slip in self._schedule.scenario.slips)
        if has_slipped or self._all_neighbours_dead(crashes) or any(isinstance(fault, Release) for fault in last):
            return find_out, True
        is_from_silence = bool(last) and all(isinstance(fault, Crash | Partition) for fault in last)
        return BACK_FROM_SILENCE if is_from_silence else BACK, False

    def _all_neighbours_dead(self, crashes: list[Crash]) -> bool:
        """Whether a robot and all its neighbours have been dead at the same time."""
        for own in crashes:
            meanwhile = {other.robot for other in crashes if other.start <= own.end and own.start <= other.end}
            if meanwhile.issuperset(self._graph[own.robot]):
                return True
        return False

    def _is_valid(self, robot: str) -> bool:
        return robot in self._latest and self._latest[robot].status is Validity.VALID

    def _lacks_motion(self, robot: str) -> bool:
        """Whether the robot is valid, or reports insufficient motion as the only reason why it is not."""
        estimate = self._latest.get(robot)
        if estimate is None or not estimate.not_observable:
            return self._is_valid(robot)
        return self._is_valid(robot) or set(estimate.reasons) == set(estimate.not_observable)

"""Load changes and slips of grasps that a robot has found, and the cause of the newest change while it is not known.

a change is noticed, or rows have been missing -> suspicion -> a slip | another load | neither, after a while
"""

from __future__ import annotations

import math

from coheft.agents.efficient.knowledge import Knowledge
from coheft.agents.efficient.load_drift import LoadChange, LoadDrift
from coheft.agents.efficient.settings import Guards, RowCounts
from coheft.agents.efficient.slips import Slip, State, Suspicion
from coheft.agents.efficient.stages import Event
from coheft.agents.efficient.unnoticed import Unnoticed, UnnoticedStep
from coheft.estimation.geometry.spatial import Array

_RECENT = 32
"""Number of newest changes in which a drift is looked for."""


class Causes:
    """The changes of one team.

    Args:
        guards: Thresholds.
        rows: For how many rows a cause is looked for (``telling_apart``; after missing rows ``after_gap``).

    Attributes:
        changes: Load changes, oldest first.
        slips: Slips of grasps, oldest first.
    """

    def __init__(self, guards: Guards, rows: RowCounts) -> None:
        self._guards, self._rows = guards, rows
        self.changes: list[LoadChange] = []
        self.slips: list[Slip] = []
        self._suspicion: Suspicion | None = None
        self._forgotten = 0  # number of changes before the robot last started over

    @property
    def changed_at(self) -> int:
        """Number of the first row with the present load, -1 if the load has never changed."""
        return self.changes[-1].first if self.changes else -1

    @property
    def news_at(self) -> int:
        """Number of the first row after the newest change of load or grasp, -1 if there was none."""
        return max(self.changed_at, self.slips[-1].first if self.slips else -1)

    @property
    def is_open(self) -> bool:
        """Whether the load seems to have changed, or a grasp to have slipped, but it is not clear which of them; a
        contradiction of motions, which the session reports by itself, does not count.
        """
        suspicion = self._suspicion
        return suspicion is not None and (suspicion.is_load or suspicion.favours_change)

    @property
    def certain_changes(self) -> list[LoadChange]:
        """Load changes that are not slips instead."""
        suspicion = self._suspicion
        is_certain = suspicion is None or suspicion.is_load_certain or not suspicion.has_grounds
        return self.changes if suspicion is None or is_certain else self.changes[: suspicion.changes]

    def load_drift(self, known: Knowledge, newest: int) -> LoadDrift | None:
        """The drift of the present load at the newest row, of this number; None if it does not drift."""
        changes, theta = self.changes[self._forgotten :][-_RECENT:], known.theta
        return None if theta is None else LoadDrift.of(changes, theta[0], newest, self._rows.drifting)

    def start_over(self) -> None:
        """Leave the changes so far out of drifts, and stop to compare with what was known before a gap or a slip."""
        self._forgotten = len(self.changes)
        if self._suspicion is not None and (self._suspicion.is_expected or self._suspicion.favours_change):
            self._suspicion = None

    def suspect(self, known: Knowledge, index: int, newest: int, state: State, unnoticed: UnnoticedStep) -> None:
        """Begin to compare causes: the row ``newest`` has shown that motions, poses or wrenches differ from this index
        on. ``unnoticed`` is the step of the mass that may have occurred before.
        """
        buffer = known.buffer
        first = int(buffer.numbers[index]) if index < buffer.count else newest
        if self._suspicion is not None and state is State.POSE_CHANGED:
            self._suspicion.notice_pose()  # where a pose has changed is not known to the row
            return
        if self._suspicion is not None and not self._suspicion.may_begin_at(first):
            self._suspicion = None
        if self._suspicion is None:
            index, changes = max(index, buffer.start), Unnoticed(unnoticed, self.load_drift(known, first))
            self._suspicion = Suspicion.of_change(
                known, index, newest, len(self.changes), state, changes, self._rows.telling_apart
            )
        elif state is State.LOAD_OR_SLIP:
            self._suspicion.notice_load()

    def expect(self, known: Knowledge, since: int, unnoticed: UnnoticedStep) -> None:
        """Compare causes from this row on: rows before were missing, or not used, so anything may have changed."""
        if self._suspicion is None or not self._suspicion.has_grounds:
            changes = Unnoticed(unnoticed, self.load_drift(known, since))
            self._suspicion = Suspicion.after_gap(known, since, len(self.changes), changes, self._rows.after_gap)

    def load_begins(self, number: int) -> None:
        """Begin the present load at this row; unless it is the first since a gap, only its rows are compared."""
        suspicion = self._suspicion
        if suspicion is None or not suspicion.is_expected:
            return
        earlier = [change for change in self.changes[suspicion.changes :] if change.first < number]
        if earlier:
            suspicion.begin_at(number, suspicion.changes + len(earlier))

    def add(self, number: int, row: Array) -> None:
        """Add a row to compare."""
        if self._suspicion is not None:
            self._suspicion.add(number, row)

    def take_back(self, number: int) -> None:
        """Forget changes and slips since this row."""
        self.changes = [change for change in self.changes if change.first < number]
        self.slips = [slip for slip in self.slips if slip.first < number]
        self._suspicion = None

    def contradiction_begins(self) -> None:
        """Note that motions contradict each other, so a grasp may have slipped, even if the load has changed."""
        if self._suspicion is not None:
            self._suspicion.notice_contradiction()

    def contradiction_ends(self, number: int) -> None:
        """Note that motions contradict each other no longer from this row on, so no grasp has slipped when they did."""
        suspicion = self._suspicion
        if suspicion is not None and suspicion.is_contradiction:
            self._suspicion = None
        elif suspicion is not None and suspicion.is_load_certain:
            suspicion.contradiction_ends(number)

    def decide(self, known: Knowledge, newest: int) -> tuple[Event, Knowledge | None] | None:
        """Decide between the causes once one of them leads, after the newest row, of this number.

        Return ``SLIPPED`` and the knowledge with a slipped grasp; ``STARTED_OVER`` if it may have slipped before all
        rows that are compared, or if it has been doubtful for too long what has changed; else None.
        """
        suspicion, guards = self._suspicion, self._guards
        if suspicion is None:
            return None
        cause = suspicion.cause(known, guards)
        if cause is not None and cause.robot is not None:
            slipped = suspicion.known_if_slipped(known, cause, guards)
            if slipped is not None:
                self._add_slip(Slip(cause.robot, cause.first, suspicion.noticed, newest))
                if not suspicion.is_load_certain:
                    del self.changes[suspicion.changes :]
                    self._forgotten = min(self._forgotten, len(self.changes))
                    if cause.is_load:
                        self.changes.append(LoadChange(cause.first, newest, suspicion.former_load, math.inf))
                self._suspicion = None
                return (Event.STARTED_OVER, None) if cause.may_be_older else (Event.SLIPPED, slipped)
        longest = self._rows.after_gap if suspicion.is_expected else self._rows.telling_apart
        if suspicion.is_load and cause is not None and cause.robot is None:
            suspicion.settle_load(self.changed_at, cause.is_load)
        elif newest - suspicion.noticed >= longest:
            self._suspicion = None
            return (Event.STARTED_OVER, None) if suspicion.favours_change else None
        return None

    def _add_slip(self, slip: Slip) -> None:
        """Add a slip; one before the last was named, of the same grasp, is that one, located better."""
        if self.slips and self.slips[-1].robot == slip.robot and slip.first <= self.slips[-1].named:
            self.slips[-1] = self.slips[-1]._replace(first=slip.first)
        else:
            self.slips.append(slip)

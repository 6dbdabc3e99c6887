"""Times at which robots hold the load, and announcements of changes to their agents."""

from __future__ import annotations

from dataclasses import dataclass

from coheft.app.faults.schedule import FaultSchedule, Release


@dataclass(frozen=True)
class HoldingNotice:
    """An announcement to an agent: from ``from_block`` on its robot holds the load, or does not."""

    holding: bool
    from_block: int


@dataclass(frozen=True)
class _ScheduledNotice:
    """A notice, and the block at which the agent receives it."""

    given_at: int
    notice: HoldingNotice


class Hands:
    """Whether one robot holds the load."""

    def __init__(self, schedule: FaultSchedule, robot: str) -> None:
        scenario = schedule.scenario
        self._block_duration = scenario.block_duration
        self._releases = [f for f in schedule.faults if isinstance(f, Release) and f.robot == robot]
        ahead = max((release.notice for release in self._releases), default=0)
        self._scheduled: list[_ScheduledNotice] = []
        held = True
        for block in range(scenario.blocks):
            if self.holds(block) != held:
                held = not held
                self._scheduled.append(_ScheduledNotice(max(0, block - ahead), HoldingNotice(held, block)))
        self._pending = list(self._scheduled)

    def holds(self, block: int) -> bool:
        """Whether the robot holds the load during a block."""
        return not any(release.is_active(block * self._block_duration) for release in self._releases)

    def tell(self, block: int) -> list[HoldingNotice]:
        """Return the notices that the agent has to receive before a block; each is returned once."""
        due = [turn.notice for turn in self._pending if turn.given_at <= block]
        self._pending = [turn for turn in self._pending if turn.given_at > block]
        return due

    def restart(self, block: int) -> None:
        """Prepare the notices for a new agent, which assumes that its robot holds the load."""
        self._pending = [turn for turn in self._scheduled if turn.notice.from_block > block]
        if not self.holds(block):
            self._pending.insert(0, _ScheduledNotice(block, HoldingNotice(False, block)))

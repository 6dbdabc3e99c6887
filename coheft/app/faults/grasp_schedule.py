"""Times at which a robot holds the load, and the notices of changes to its agent."""

from typing import NamedTuple

from coheft.app.faults.schedule import FaultSchedule, Release


class HoldingNotice(NamedTuple):
    """A notice before block ``sent_at`` that the robot holds the load, or does not, from block ``from_block`` on."""

    sent_at: int
    holding: bool
    from_block: int


class GraspSchedule:
    """Whether one robot holds the load."""

    def __init__(self, schedule: FaultSchedule, robot: str) -> None:
        scenario = schedule.scenario
        self._block_duration = scenario.block_duration
        self._releases = [f for f in schedule.faults if isinstance(f, Release) and f.robot == robot]
        ahead = max((release.notice for release in self._releases), default=0)
        self._notices: list[HoldingNotice] = []
        held = True
        for block in range(scenario.blocks):
            if self.holds(block) != held:
                held = not held
                self._notices.append(HoldingNotice(max(0, block - ahead), held, block))
        self._pending = list(self._notices)

    def holds(self, block: int) -> bool:
        """Whether the robot holds the load during a block."""
        return not any(release.is_active(block * self._block_duration) for release in self._releases)

    def due(self, block: int) -> list[HoldingNotice]:
        """Return the notices that the agent has to receive before a block; each is returned once."""
        due = [notice for notice in self._pending if notice.sent_at <= block]
        self._pending = self._pending[len(due) :]
        return due

    def restart(self, block: int) -> None:
        """Prepare the notices for a new agent, which assumes that its robot holds the load."""
        self._pending = [notice for notice in self._notices if notice.from_block > block]
        if not self.holds(block):
            self._pending.insert(0, HoldingNotice(block, False, block))

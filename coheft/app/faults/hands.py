"""Who has hold of the load, and what the robots' agents are told of that."""

from __future__ import annotations

from dataclasses import dataclass

from coheft.app.faults.schedule import FaultSchedule, Release


@dataclass(frozen=True)
class HoldingNotice:
    """What an agent is told: from ``from_block`` on its robot has hold of the load, or not."""

    holding: bool
    from_block: int


@dataclass(frozen=True)
class _Turn:
    """A notice, and the block at which it is given."""

    told_at: int
    notice: HoldingNotice


class Hands:
    """One robot's hand on the load."""

    def __init__(self, schedule: FaultSchedule, robot: str) -> None:
        scenario = schedule.scenario
        self._block_duration = scenario.block_duration
        self._releases = [f for f in schedule.faults if isinstance(f, Release) and f.robot == robot]
        ahead = max((release.notice for release in self._releases), default=0)
        self._turns: list[_Turn] = []
        held = True
        for block in range(scenario.blocks):
            if self.holds(block) != held:
                held = not held
                self._turns.append(_Turn(max(0, block - ahead), HoldingNotice(held, block)))
        self._open = list(self._turns)

    def holds(self, block: int) -> bool:
        """Whether it holds the load during a block."""
        return not any(release.is_active(block * self._block_duration) for release in self._releases)

    def tell(self, block: int) -> list[HoldingNotice]:
        """What an agent that has not been told yet is to be told before a block."""
        due = [turn.notice for turn in self._open if turn.told_at <= block]
        self._open = [turn for turn in self._open if turn.told_at > block]
        return due

    def restart(self, block: int) -> None:
        """A fresh agent, which takes its robot to hold the load, starts with a block."""
        self._open = [turn for turn in self._turns if turn.notice.from_block > block]
        if not self.holds(block):
            self._open.insert(0, _Turn(block, HoldingNotice(False, block)))

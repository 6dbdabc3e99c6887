"""Restarts of agents that fail during a run."""

from collections.abc import Callable
from dataclasses import dataclass

from coheft.app.run.observer import Observer
from coheft.app.run.processes import Child, Processes
from coheft.app.terminal.screen import Display
from coheft.errors import CoheftError
from coheft.wire.messages.states import RunState
from coheft.wire.messages.structs import Problem
from coheft.wire.process.supervised import UNUSABLE
from coheft.wire.transport.planes import SERVER


@dataclass(frozen=True)
class Restarts:
    """Restarts agents that fail, each up to ``limit`` times, shows that, and announces their new process ids."""

    limit: int
    processes: Processes
    observer: Observer
    display: Display
    announce: Callable[[], None]

    def check(self, *, has_begun: bool = True) -> None:
        """Restart agents that have failed; a ``ProcessError`` says why that is not possible (any more).

        Before the run has begun, it is enough that the server's process runs, which may answer late.
        """
        failed = self.processes.failed
        if not failed:
            return
        goes_on = self._goes_on if has_begun else lambda: not self.processes.ended(SERVER)
        if not (all(self._may_try_again(child) for child in failed) and goes_on()):
            is_server_there = all(child.name != SERVER for child in failed)
            self.processes.check(self.limit if is_server_there else None)
        for child in failed:
            text = f"{child.name} {child.how_and_why}; restarted ({child.restarts + 1} of {self.limit})"
            self.processes.start_again(child)
            self.display.problem(Problem(source="supervisor", text=text))
        try:
            self.announce()
        except CoheftError as error:  # the run continues, although other commands may not find it
            self.display.problem(Problem(source="supervisor", text=str(error)))

    def _may_try_again(self, child: Child) -> bool:
        return child.name != SERVER and child.restarts < self.limit and child.status != UNUSABLE

    def _goes_on(self) -> bool:
        while (status := self.observer.status()) is None:
            if self.observer.has_lost_server or self.processes.ended(SERVER):
                return False
        return status.state in (RunState.RUNNING, RunState.PAUSED)

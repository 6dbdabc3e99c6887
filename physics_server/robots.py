"""All robots of a run as the server sees them: who takes part, who is late, who is silent, who is away."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping

from coheft.errors import LinkError, MessageError
from coheft.physics_server.absence import Absences
from coheft.physics_server.late_answers import LateAnswers
from coheft.wire.messages.structs import Measurements, Message, Reference
from coheft.wire.process.problem_log import ProblemLog
from coheft.wire.transport.robot_link import RobotLink

ANSWER_LIMIT = 10.0
"""A robot that has not answered for so long is reported [s]."""


class Robots:
    """The links of all robots.

    Args:
        links: One per robot.
        problems: Where it is told what is wrong with them.
        return_limit: How long the return of one that is lost is waited for [s].
    """

    def __init__(self, links: Iterable[RobotLink], problems: ProblemLog, return_limit: float) -> None:
        self._links = {link.name: link for link in links}
        self._problems = problems
        self._return_limit = return_limit
        self._absences = Absences(return_limit)
        self._is_under_way = False
        self._over: str | None = None
        self._next = 0
        self._silent_since = math.inf
        self._late = LateAnswers()

    def go_on(self) -> None:
        """Time runs from now on, for the first time or after a pause."""
        self._is_under_way = True
        self._silent_since = time.monotonic()

    def send_stop(self, reason: str) -> None:
        """Tell all that the run is over, and those that come back later."""
        self._is_under_way, self._over = False, reason
        for link in self._links.values():
            link.send_stop(reason)

    # --- what they say ---

    def take(self, name: str, message: Message) -> None:
        """Take in what a robot said; it may be back."""
        link = self._links[name]
        was_ready = link.is_ready
        try:
            link.take(message)
        except MessageError as error:
            self._problems.tell(f"refused from {name}: {error}")
        if was_ready or not link.is_ready:
            return
        if self._over is not None:
            link.send_stop(self._over)
        elif self._is_under_way:
            self._absences.end(name)
            link.join(self._next)
            self._problems.tell(f"{name} is back before block {self._next}")

    def note_links(self, name: str, count: int) -> None:
        """Note how many processes are at the other end of a robot's link."""
        link = self._links[name]
        answered = link.answered
        link.note_links(count)
        if count == 0 and self._is_under_way:
            self._absences.begin(name)
            self._problems.tell(f"lost the link with {name}, which had answered block {answered}")

    # --- one block ---

    @property
    def late_references(self) -> int:
        """References that came too late, over all robots: several in a block for which several robots were late."""
        return self._late.count

    def take_references(self, block: int, moment: float) -> dict[str, Reference]:
        """What their arms shall do during a block, which begins at that moment [s], as far as it has come."""
        references, late = {}, []
        for name, link in self._links.items():
            reference = link.take_reference(block)
            if reference is not None:
                references[name] = reference
            elif link.is_late(block):
                late.append(name)
        if (text := self._late.add(late, moment)) is not None:
            self._problems.tell(text)
        return references

    def send_measurements(self, measurements: Mapping[str, Measurements], block: int, estimator: str) -> None:
        """Send each that takes part its own measurements of a block, and the estimator to use."""
        for name, link in self._links.items():
            if link.is_ready:
                link.send_measurements(measurements[name], estimator)
        self._next = block + 1
        self._silent_since = time.monotonic()

    # --- who is missing ---

    @property
    def answered(self) -> int | None:
        """The newest block that all who take part have answered; None if no robot does."""
        return min((link.answered for link in self._links.values() if link.is_ready), default=None)

    @property
    def not_ready(self) -> list[str]:
        """Robots without which the run does not begin."""
        return [name for name, link in self._links.items() if not link.is_settled]

    @property
    def in_debt(self) -> list[str]:
        """Robots that are there, but have not answered the latest block."""
        return [name for name, link in self._links.items() if link.is_linked and link.owes_answer]

    @property
    def away(self) -> list[str]:
        """Robots that are lost, and may still come back in time."""
        return self._absences.waited_for

    def check(self) -> None:
        """Report robots that have not answered for long, and go on without those that are away for too long.

        Raises:
            LinkError: All are.
        """
        self._report_silence()
        for name in self._absences.give_up():
            self._problems.tell(f"{name} did not come back within {self._return_limit:g} s: the run goes on without it")
        if len(self._absences.given_up) == len(self._links):
            raise LinkError(f"all robots are gone, and none came back within {self._return_limit:g} s")

    def _report_silence(self) -> None:
        """Tell observers, once, of robots that have not answered for long."""
        if time.monotonic() - self._silent_since < ANSWER_LIMIT:
            return
        self._silent_since = math.inf
        slowest = self.answered
        silent = [name for name in self.in_debt if self._links[name].answered == slowest]
        if slowest is not None and silent:
            self._problems.tell(f"{', '.join(silent)} did not answer block {slowest + 1} within {ANSWER_LIMIT:g} s")

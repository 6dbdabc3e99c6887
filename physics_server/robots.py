"""All robots of a run as the server sees them: which take part, and which are late, silent or away."""

import math
import time
from collections.abc import Iterable, Mapping

from coheft.errors import LinkError, MessageError
from coheft.physics_server.late_answers import LateAnswers
from coheft.wire.messages.structs import Measurements, Message, Reference
from coheft.wire.process.problem_log import ProblemLog
from coheft.wire.transport.robot_link import RobotLink

ANSWER_LIMIT = 10.0
"""Time without an answer after which a robot is reported [s]."""


class Robots:
    """The links of all robots."""

    def __init__(self, links: Iterable[RobotLink], problems: ProblemLog, return_limit: float) -> None:
        self._links = {link.name: link for link in links}
        self._problems = problems
        self._return_limit = return_limit
        self._waited_for: dict[str, float] = {}  # deadlines for the return of robots, from the first loss of their link
        self._given_up: set[str] = set()
        self._is_running = False
        self._stop_reason: str | None = None
        self._next = 0
        self._silent_since = math.inf
        self._late = LateAnswers()

    def go_on(self) -> None:
        """Note that time runs from now on, at first or after a pause."""
        self._is_running = True
        self._silent_since = time.monotonic()

    def send_stop(self, reason: str) -> None:
        """Tell all robots that the run is over; robots that come back later are told on arrival."""
        self._is_running, self._stop_reason = False, reason
        for link in self._links.values():
            link.send_stop(reason)

    # --- their messages ---

    def take(self, name: str, message: Message) -> None:
        """Process a robot's message; if the robot has returned, it takes part again."""
        link = self._links[name]
        was_ready = link.is_ready
        try:
            link.take(message)
        except MessageError as error:
            self._problems.tell(f"refused from {name}: {error}")
        if was_ready or not link.is_ready:
            return
        if self._stop_reason is not None:
            link.send_stop(self._stop_reason)
        elif self._is_running:
            self._waited_for.pop(name, None)
            self._given_up.discard(name)
            link.join(self._next)
            self._problems.tell(f"{name} is back before block {self._next}")

    def note_link(self, name: str, is_linked: bool) -> None:
        """Note whether a process is at the other end of a robot's link."""
        link = self._links[name]
        answered = link.answered
        link.note_link(is_linked)
        if not is_linked and self._is_running:
            if name not in self._given_up:
                self._waited_for.setdefault(name, time.monotonic() + self._return_limit)
            so_far = "before its first answer" if answered < 0 else f"which had answered block {answered}"
            self._problems.tell(f"lost the link with {name}, {so_far}")

    # --- one block ---

    @property
    def late_references(self) -> int:
        """Number of references that were late, summed over all robots."""
        return self._late.count

    def take_references(self, block: int, moment: float) -> dict[str, Reference]:
        """Return the references of a block that have arrived, by robot; ``moment`` is the start of the block [s]."""
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
        """Send each participating robot its own measurements of a block, and the estimator to use."""
        for name, link in self._links.items():
            if link.is_ready:
                link.send_measurements(measurements[name], estimator)
        self._next = block + 1
        self._silent_since = time.monotonic()

    # --- missing robots ---

    @property
    def answered(self) -> int | None:
        """The newest block that all participating robots have answered; None if no robot takes part."""
        return min((link.answered for link in self._links.values() if link.is_ready), default=None)

    @property
    def not_ready(self) -> list[str]:
        """Robots that the start of the run still waits for."""
        return [name for name, link in self._links.items() if not link.is_settled]

    @property
    def in_debt(self) -> list[str]:
        """Robots that are linked but have not answered the latest block."""
        return [name for name, link in self._links.items() if link.is_linked and link.owes_answer]

    @property
    def away(self) -> list[str]:
        """Robots that are lost and may still return in time."""
        return list(self._waited_for)

    def check(self) -> None:
        """Report robots that have not answered for long, and continue without those that have been away for too long.

        It raises a ``LinkError`` if all robots have.
        """
        self._report_silence()
        now = time.monotonic()
        for name in [name for name, deadline in self._waited_for.items() if deadline <= now]:
            del self._waited_for[name]
            self._given_up.add(name)
            self._problems.tell(f"{name} did not return within {self._return_limit:g} s: the run continues without it")
        if len(self._given_up) == len(self._links):
            raise LinkError(f"all robots are lost, and none returned within {self._return_limit:g} s")

    def _report_silence(self) -> None:
        """Report robots that have not answered for long, once."""
        if time.monotonic() - self._silent_since < ANSWER_LIMIT:
            return
        self._silent_since = math.inf
        slowest = self.answered
        silent = [name for name in self.in_debt if self._links[name].answered == slowest]
        if slowest is not None and silent:
            self._problems.tell(f"{', '.join(silent)} did not answer block {slowest + 1} within {ANSWER_LIMIT:g} s")

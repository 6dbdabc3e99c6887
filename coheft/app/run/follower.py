"""Whoever follows a run beside the report: a recorder, a view, curves over time."""

from __future__ import annotations

from coheft.app.run.heard import News
from coheft.wire.messages.requests import Status


class Follower:
    """Hears a run from its start to its end, in the supervisor's thread, so it must be quick; base of all that do."""

    def begin(self, status: Status) -> None:
        """All links stand and the clock runs: who holds the payload, for how long."""

    def hear(self, news: News) -> None:
        """Somebody has said something that makes sense."""

    def end(self, status: Status) -> None:
        """The run has ended; not called if it failed."""

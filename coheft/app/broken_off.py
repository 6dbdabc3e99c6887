"""What somebody who breaks a run off with Ctrl-C has to know: when that was, and what is not there now."""

from __future__ import annotations

from collections.abc import Mapping

from coheft.app.heard import News
from coheft.wire.messages import Truth
from coheft.wire.requests import Status

WRITTEN_AT_THE_END = {"json": "report (--json)", "report": "page (--report)", "save_data": "data file (--save-data)"}
"""What a run that ends by itself, or by 'coheft stop', writes."""


class BrokenOff:
    """A follower that knows how far a run has come.

    Args:
        asked: Where things were to be written, by the names in ``WRITTEN_AT_THE_END`` and ``record``; None: not asked.

    Attributes:
        unsaved: Why the data file is not there though the run has ended; empty if it is, or was not asked for.
    """

    def __init__(self, asked: Mapping[str, object | None]) -> None:
        self.unsaved = ""
        self._asked = asked
        self._time: float | None = None

    def begin(self, status: Status) -> None:
        """The run begins."""

    def hear(self, news: News) -> None:
        """Time goes on."""
        if isinstance(news, Truth):
            self._time = news.time

    def end(self, status: Status) -> None:
        """The run has ended."""
        self.unsaved = status.unsaved

    def sentence(self) -> str:
        """What is to be said if it is broken off now."""
        when = "before it began" if self._time is None else f"at {self._time:.1f} s"
        missing = [f"no {what}" for key, what in WRITTEN_AT_THE_END.items() if self._asked.get(key) is not None]
        recording = self._asked.get("record")
        clauses = []
        if recording is not None and self._time is not None:
            clauses.append(f"{recording} holds what came until then")
        if missing:
            was, it = ("was", "it") if len(missing) == 1 else ("were", "them")
            clauses.append(f"{' and '.join(missing)} {was} written; 'coheft stop' ends a run with {it}")
        return f"stopped {when}{': ' * bool(clauses)}{'; '.join(clauses)}"

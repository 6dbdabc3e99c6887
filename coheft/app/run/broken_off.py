"""What somebody whose run breaks off, by Ctrl-C or an error, has to know: when that was, and what is not there now."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from coheft.app.run.follower import Follower
from coheft.app.run.heard import News
from coheft.wire.messages.requests import Status
from coheft.wire.messages.structs import Truth

if TYPE_CHECKING:  # it takes an extra
    from coheft.app.recording.recorder import Recorder

WRITTEN_AT_THE_END = {"json": "report (--json)", "report": "page (--report)", "save_data": "data file (--save-data)"}
"""What a run that ends by itself, or by 'coheft stop', writes."""


class BrokenOff(Follower):
    """Knows how far a run has come.

    Args:
        asked: Where things were to be written, by the names in ``WRITTEN_AT_THE_END`` and ``record``; None: not asked.
        logs: Folder with the processes' logs.
        recorder: Of the recording, None if there is none.

    Attributes:
        unsaved: Why the data file is not there though the run has ended; empty if it is, or was not asked for.
    """

    def __init__(self, asked: Mapping[str, str | Path | None], logs: Path, recorder: Recorder | None = None) -> None:
        self.unsaved = ""
        self._asked = asked
        self._logs = logs
        self._recorder = recorder
        self._old_data = self._data_written_at()
        self._time: float | None = None

    def hear(self, news: News) -> None:
        """Time goes on."""
        if isinstance(news, Truth):
            self._time = news.time

    def end(self, status: Status) -> None:
        """The run has ended."""
        self.unsaved = status.unsaved

    def sentence(self) -> str:
        """What is to be said if Ctrl-C breaks it off now."""
        with_it = {0: "its report", 1: "it"}.get(len(self._missing()), "them")
        clauses = [*self._clauses(), f"'coheft stop' ends a run with {with_it}", f"the logs are in {self._logs}"]
        return f"stopped {self._when}: {'; '.join(clauses)}"

    def after_error(self) -> str:
        """What is to be said after an error that breaks it off now, on a line of its own; empty if nothing."""
        clauses = self._clauses()
        return f"\nThat was {self._when}: {'; '.join(clauses)}." if clauses else ""

    @property
    def _when(self) -> str:
        return "before it began" if self._time is None else f"at {self._time:.1f} s"

    def _clauses(self) -> list[str]:
        """What is there of the files that were asked for, and what not."""
        unsaved_recording = "" if self._recorder is None else self._recorder.problem
        kept = [self._asked.get("record")] if self._time is not None and not unsaved_recording else []
        if self._has_data:
            kept.append(self._asked.get("save_data"))
        clauses = [f"{path} holds what came until then" for path in kept if path is not None]
        clauses += [unsaved_recording] if unsaved_recording else []
        if missing := self._missing():
            clauses.append(f"{' and '.join(missing)} {'was' if len(missing) == 1 else 'were'} written")
        return clauses

    def _missing(self) -> list[str]:
        names = [key for key in WRITTEN_AT_THE_END if self._asked.get(key) is not None]
        return [f"no {WRITTEN_AT_THE_END[key]}" for key in names if key != "save_data" or not self._has_data]

    @property
    def _has_data(self) -> bool:
        """Whether the server, though it failed, has written the data file."""
        return self._data_written_at() != self._old_data

    def _data_written_at(self) -> int | None:
        """When what there is was written [ns]; None if there is nothing."""
        path = self._asked.get("save_data")
        try:
            return None if path is None else Path(path).stat().st_mtime_ns
        except OSError:
            return None

"""What a user needs to know when a signal or an error aborts a run: when that was, and which files are missing."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from coheft.app.run.follower import Follower
from coheft.app.run.news import News
from coheft.wire.messages.requests import Status
from coheft.wire.messages.truth import Truth

if TYPE_CHECKING:  # needs an optional package
    from coheft.app.recording.recorder import Recorder

WRITTEN_AT_THE_END = {"json": "report (--json)", "report": "page (--report)", "save_data": "data file (--save-data)"}
"""Outputs that are written when a run ends by itself, by 'coheft stop', or by one Ctrl-C."""


class BrokenOff(Follower):
    """Keeps track of the progress of a run, and of its outputs.

    ``asked`` are the paths of outputs by the names in ``WRITTEN_AT_THE_END`` and ``record``; None if not requested.

    Attributes:
        unsaved: Why the data file is missing after the end of the run; empty if it is not, or was not requested.
    """

    def __init__(self, asked: Mapping[str, str | Path | None], logs: Path, recorder: Recorder | None = None) -> None:
        self.unsaved = ""
        self._asked = asked
        self._logs = logs
        self._recorder = recorder
        self._old_data = self._data_written_at()
        self._time: float | None = None

    def receive(self, news: News) -> None:
        """See ``Follower.receive``."""
        if isinstance(news, Truth):
            self._time = news.time

    def end(self, status: Status) -> None:
        """See ``Follower.end``."""
        self.unsaved = status.unsaved

    def sentence(self, reason: str = "") -> str:
        """Return the message for a run that is aborted now: by a signal, and for a reason if one Ctrl-C was not enough
        to end it.
        """
        with_it = {0: "its report", 1: "it"}.get(len(self._missing()), "them")
        advice = f"'coheft stop', or Ctrl-C pressed once, ends a run with {with_it}" if self._time is not None else ""
        clauses = [reason, *self._clauses(), "" if reason else advice, f"the logs are in {self._logs}"]
        return f"stopped {self._when}: {'; '.join(filter(None, clauses))}"

    def after_error(self) -> str:
        """Return the message that follows an error that aborts the run now, on a separate line; may be empty."""
        clauses = self._clauses()
        return f"\nThat was {self._when}: {'; '.join(clauses)}." if clauses else ""

    @property
    def _when(self) -> str:
        return "before it began" if self._time is None else f"at {self._time:.1f} s"

    def _clauses(self) -> list[str]:
        """Describe which of the requested files exist."""
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
        """Whether the server has written the data file, although the run failed."""
        return self._data_written_at() != self._old_data

    def _data_written_at(self) -> int | None:
        """Return the time when the present data file was written [ns]; None if there is none."""
        path = self._asked.get("save_data")
        try:
            return None if path is None else Path(path).stat().st_mtime_ns
        except OSError:
            return None

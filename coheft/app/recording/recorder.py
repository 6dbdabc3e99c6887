"""Records a run while it goes on."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import BinaryIO, Self

from coheft.app.recording.mcap_file import McapFile
from coheft.app.recording.writer import RunWriter
from coheft.app.run.follower import Follower
from coheft.app.run.heard import News
from coheft.errors import RecordingError
from coheft.wire.messages.requests import Status
from coheft.wire.scenario.schema import Scenario

_FLUSH_EVERY = 1.0
"""Wall time of which a killed run loses the recording at most [s]."""


class Recorder(Follower):
    """Writes all that it hears to an MCAP file.

    It writes in a thread of its own: Ctrl-C ends what the main thread does in the middle, and a message that was
    written by half would spoil the file. Leaving the context finishes the file, however the run has ended; a run that
    never began leaves none. When the file cannot be written any more, the run goes on without it: what else it finds is
    not to be lost with it.

    Args:
        path: Must not be there yet.
        scenario: What is run.

    Raises:
        RecordingError: The file is there, or cannot be written.
    """

    def __init__(self, path: Path, scenario: Scenario) -> None:
        self._path = path
        self._scenario = scenario
        self._news: SimpleQueue[Status | News | None] = SimpleQueue()
        self._failure: Exception | None = None
        self._flush_at = 0.0
        self._file = _create(path)
        self._thread = threading.Thread(target=self._work, name="recorder")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._news.put(None)
        self._thread.join()
        if error is None and self._failure is not None and not self.problem:
            raise self._failure

    def begin(self, status: Status) -> None:
        """The run begins."""
        self._news.put(status)

    def hear(self, news: News) -> None:
        """Somebody has said something."""
        if self._failure is None:
            self._news.put(news)

    @property
    def problem(self) -> str:
        """Why the file could not be written any more, and what to do; empty if it could."""
        if not isinstance(self._failure, OSError):
            return ""
        return (
            f"{self._path}: could not be written any more: {self._failure.strerror}. To save what there is: "
            f"coheft recover {self._path}"
        )

    def _work(self) -> None:
        try:
            with self._file:
                self._write(McapFile(self._file))
        except Exception as error:  # the main thread raises it
            self._failure = error

    def _write(self, out: McapFile) -> None:
        begin = self._next(out)
        if not isinstance(begin, Status):
            self._path.unlink()
            return
        run = RunWriter(out, self._scenario, begin)
        while (news := self._next(out)) is not None:
            if not isinstance(news, Status):
                run.hear(news)
        out.finish()

    def _next(self, out: McapFile) -> Status | News | None:
        """Wait for what is to be written next; None is the end. Meanwhile, flush when it is time."""
        while True:
            wait = self._flush_at - time.monotonic()
            if wait <= 0.0:
                out.flush()
                self._flush_at = time.monotonic() + _FLUSH_EVERY
                continue
            try:
                return self._news.get(timeout=wait)
            except Empty:
                if not threading.main_thread().is_alive():  # it was interrupted before it could say so
                    return None


def _create(path: Path) -> BinaryIO:
    try:
        return path.open("xb")
    except FileExistsError as error:
        raise RecordingError(f"{path} is there already: give another name, or remove it") from error
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written: {error.strerror}") from error

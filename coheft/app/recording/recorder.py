"""Recording of a run in progress."""

import threading
import time
from pathlib import Path
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import BinaryIO, Self

from coheft.app.recording.mcap_file import McapFile
from coheft.app.recording.writer import RunWriter
from coheft.app.run.follower import Follower
from coheft.app.run.news import News
from coheft.errors import RecordingError
from coheft.wire.messages.requests import Status
from coheft.wire.scenario.schema import Scenario

_FLUSH_EVERY = 1.0
"""Largest wall time at the end of a killed run that is missing in its recording [s]."""


class Recorder(Follower):
    """Writes all messages to an MCAP file.

    It writes in a separate thread, because Ctrl-C may interrupt the main thread anywhere, and a partly written message
    would damage the file. Leaving the context completes the file, however the run ended; for a run that never began,
    the file is removed. If the file can no longer be written, the run continues without it, so that its other results
    are not lost.

    Raises:
        RecordingError: The file exists already, or cannot be written.
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
        """See ``Follower.begin``."""
        self._news.put(status)

    def receive(self, news: News) -> None:
        """See ``Follower.receive``."""
        if self._failure is None:
            self._news.put(news)

    @property
    def problem(self) -> str:
        """Why the file could no longer be written, and what to do; empty if it could."""
        if not isinstance(self._failure, OSError):
            return ""
        return (
            f"{self._path}: could no longer be written: {self._failure.strerror}. To save its content: "
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
                run.receive(news)
        out.finish()

    def _next(self, out: McapFile) -> Status | News | None:
        """Wait for the next item to write; None is the end. Flush regularly meanwhile."""
        while True:
            wait = self._flush_at - time.monotonic()
            if wait <= 0.0:
                out.flush()
                self._flush_at = time.monotonic() + _FLUSH_EVERY
                continue
            try:
                return self._news.get(timeout=wait)
            except Empty:
                if not threading.main_thread().is_alive():  # it was interrupted before it could end the recording
                    return None


def _create(path: Path) -> BinaryIO:
    try:
        return path.open("xb")
    except FileExistsError as error:
        raise RecordingError(f"{path} exists already: give another name, or remove it") from error
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written: {error.strerror}") from error

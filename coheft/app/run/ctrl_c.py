"""The first Ctrl-C of a run: it asks for the end of the run, and the results so far are written."""

import signal
import threading
from types import FrameType, TracebackType
from typing import Self

SENTENCE = "Ctrl-C: the run ends now, and its results so far are being written; a second Ctrl-C ends it at once"


class FirstCtrlC:
    """While the context lasts, the first Ctrl-C is only noted; a second one raises ``KeyboardInterrupt``, as usual.

    Where Ctrl-C does not raise ``KeyboardInterrupt`` anyway, for instance in background jobs of shells, and in other
    threads than the main thread, nothing changes.

    Attributes:
        is_pressed: Whether there has been a first one; this remains after the context.
    """

    def __init__(self) -> None:
        self.is_pressed = False
        self._is_new = False
        self._is_here = False

    def take(self) -> bool:
        """Whether there has been a first one since the last call."""
        is_new, self._is_new = self._is_new, False
        return is_new

    def _note(self, _number: int, _frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        self.is_pressed = self._is_new = True

    def __enter__(self) -> Self:
        is_usual = signal.getsignal(signal.SIGINT) is signal.default_int_handler
        self._is_here = is_usual and threading.current_thread() is threading.main_thread()
        if self._is_here:
            signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(self, _kind: type[BaseException] | None, _error: object, _traceback: TracebackType | None) -> None:
        if self._is_here:
            signal.signal(signal.SIGINT, signal.default_int_handler)

"""The first Ctrl-C of a run: it asks for the end of the run, and the results so far are written."""

import signal
import threading
import time
from types import FrameType, TracebackType
from typing import Self

SENTENCE = "Ctrl-C: the run ends now, and its results so far are being written; a second Ctrl-C ends it at once"


_SAME_PRESS = 0.3
"""Time within which a second signal counts as the same press [s]: some wrappers forward what the terminal sends too."""


class FirstCtrlC:
    """From ``begin`` to ``end``, the first Ctrl-C is only noted; a second one raises ``KeyboardInterrupt``, as usual.

    Where Ctrl-C does not raise ``KeyboardInterrupt`` anyway, for instance in background jobs of shells, and in other
    threads than the main thread, nothing changes. At the end of its context it ends as well.

    Attributes:
        is_pressed: Whether there has been a first one; this remains after the end.
    """

    def __init__(self) -> None:
        self.is_pressed = False
        self._is_new = False
        self._is_here = False
        self._pressed_at = 0.0

    def begin(self) -> None:
        """Begin to note the first Ctrl-C."""
        is_usual = signal.getsignal(signal.SIGINT) is signal.default_int_handler
        self._is_here = is_usual and threading.current_thread() is threading.main_thread()
        if self._is_here:
            signal.signal(signal.SIGINT, self._note)

    def end(self) -> None:
        """From now on, every Ctrl-C raises ``KeyboardInterrupt``."""
        if self._is_here:
            signal.signal(signal.SIGINT, signal.default_int_handler)
            self._is_here = False

    def take(self) -> bool:
        """Whether there has been a first one since the last call."""
        is_new, self._is_new = self._is_new, False
        return is_new

    def _note(self, number: int, frame: FrameType | None) -> None:
        if not self.is_pressed:
            self.is_pressed, self._is_new, self._pressed_at = True, True, time.monotonic()
        elif time.monotonic() > self._pressed_at + _SAME_PRESS:
            signal.default_int_handler(number, frame)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _kind: type[BaseException] | None, _error: object, _traceback: TracebackType | None) -> None:
        self.end()

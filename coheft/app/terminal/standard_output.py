"""Standard output that cannot be written: commands go on to their end, save their files, and then say so."""

from __future__ import annotations

import os
import sys
from io import BufferedWriter, FileIO, TextIOWrapper
from typing import Any, TextIO


class _Output(FileIO):
    """Standard output or error; after the first failure, what is written there goes nowhere.

    Attributes:
        failure: Why; None as long as all is well.
    """

    failure: OSError | None = None

    def write(self, data: Any, /) -> int:
        """Write, or drop what cannot be written."""
        if self.failure is None:
            try:
                return super().write(data)
            except OSError as error:
                self.failure = error
        return memoryview(data).nbytes


def guard_standard_streams() -> None:
    """Let nothing that is printed fail, whatever has become of standard output and error.

    Those that are closed are opened such that whatever is written there is lost: or the next socket would get their
    number, and what is printed.
    """
    if os.name != "posix":  # elsewhere a console is no file
        return
    while (number := os.open(os.devnull, os.O_RDONLY)) <= 2:  # the lowest that is free
        os.set_inheritable(number, True)  # or processes that are started would have the same trouble
    os.close(number)
    sys.stdout = _guarded(sys.stdout, 1)
    sys.stderr = _guarded(sys.stderr, 2)


def _guarded(stream: TextIO | None, number: int) -> TextIOWrapper:
    """A stream like another one, which is None if it was closed."""
    encoding, errors, is_by_line = "utf-8", "strict", False
    if isinstance(stream, TextIOWrapper):
        encoding, errors = stream.encoding, stream.errors or errors
        is_by_line = stream.line_buffering or stream.write_through
    if errors == "strict":  # or a unit that the terminal does not know ends the command
        errors = "backslashreplace"
    output = BufferedWriter(_Output(number, "w", closefd=False))
    return TextIOWrapper(output, encoding, errors, line_buffering=is_by_line)


def lost_output() -> OSError | None:
    """Why something that was printed has not arrived; None if all has."""
    try:
        sys.stdout.flush()
    except OSError as error:  # where nothing guards it
        return error
    raw = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    return raw.failure if isinstance(raw, _Output) else None


def check_standard_output() -> None:
    """For commands that do nothing but print.

    Raises:
        OSError: What is printed does not arrive.
    """
    if failure := lost_output():
        raise failure

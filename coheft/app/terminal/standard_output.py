"""Standard output that cannot be written: commands continue to their end, save their files, and then report it."""

import os
import sys
from io import BufferedWriter, FileIO, TextIOWrapper
from typing import Any, TextIO


class _Output(FileIO):
    """Standard output or standard error; after the first failure, output is discarded.

    Attributes:
        failure: The first error; None if there was none.
    """

    failure: OSError | None = None

    def write(self, data: Any, /) -> int:
        """Write data, or discard it after a failure."""
        if self.failure is None:
            try:
                return super().write(data)
            except OSError as error:
                self.failure = error
        return memoryview(data).nbytes


def guard_standard_streams() -> None:
    """Make sure that printing never fails, even if standard output or standard error is closed.

    Closed streams are opened on the null device: otherwise the next socket would get their file number, and printed
    text would go there.
    """
    if os.name != "posix":  # elsewhere a console is not a file
        return
    while (number := os.open(os.devnull, os.O_RDONLY)) <= 2:  # returns the lowest free number
        os.set_inheritable(number, True)  # otherwise child processes would have the same problem
    os.close(number)
    sys.stdout = _guarded(sys.stdout, 1)
    sys.stderr = _guarded(sys.stderr, 2)


def _guarded(stream: TextIO | None, number: int) -> TextIOWrapper:
    """Return a guarded stream with the settings of another one, which is None if it was closed."""
    encoding, errors, is_by_line = "utf-8", "strict", False
    if isinstance(stream, TextIOWrapper):
        encoding, errors = stream.encoding, stream.errors or errors
        is_by_line = stream.line_buffering or stream.write_through
    if errors == "strict":  # otherwise a character that the terminal does not support would end the command
        errors = "backslashreplace"
    output = BufferedWriter(_Output(number, "w", closefd=False))
    return TextIOWrapper(output, encoding, errors, line_buffering=is_by_line)


def lost_output() -> OSError | None:
    """Return the error because of which printed text was lost; None if there was none."""
    try:
        sys.stdout.flush()
    except OSError as error:  # if the stream is not guarded
        return error
    raw = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    return raw.failure if isinstance(raw, _Output) else None

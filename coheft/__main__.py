"""``python -m coheft``, and the command ``coheft``."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

_STATUS = 130
"""Of a command that was stopped, as ``coheft.app.cli.base`` has it, which is not loaded yet."""


def main() -> None:
    """Run the command line and leave with its exit status."""
    # A polite request to end, or a terminal that goes, is as good as Ctrl-C: what a command has started ends with it.
    names = [name for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    heard = [number for number in map(signal.Signals.__getitem__, names) if signal.getsignal(number) != signal.SIG_IGN]
    for number in heard:  # nohup ignores hang-ups, a shell Ctrl-C for what is in the background
        signal.signal(number, _leave)
    from coheft.app.terminal.standard_output import guard_standard_streams

    guard_standard_streams()
    from coheft.app.cli.main import run_command_line

    try:
        for number in heard:
            signal.signal(number, signal.default_int_handler)
        status = run_command_line(sys.argv[1:])
    except KeyboardInterrupt:  # a moment before the command listens to it, or after
        print("stopped", file=sys.stderr)
        status = _STATUS
    sys.exit(status)


def _leave(number: int, frame: FrameType | None) -> None:
    """End while all that has happened is that modules were loaded."""
    try:
        os.write(2, b"stopped\n")
    finally:
        os._exit(_STATUS)


if __name__ == "__main__":
    main()

"""``python -m coheft``, and the command ``coheft``."""

import os
import sys

_STATUS = 130
"""Exit status after Ctrl-C, equal to that in ``coheft.app.cli.base``, which is not loaded yet."""


def _leave(*_: object) -> None:
    """Exit at once, while modules are being loaded."""
    try:
        os.write(2, b"stopped\n")
    finally:
        os._exit(_STATUS)


try:
    import signal
except KeyboardInterrupt:
    _leave()


def main() -> None:
    """Run the command line and leave with its exit status."""
    # SIGTERM, and the end of the terminal, have the same effect as Ctrl-C: processes that a command has started end
    # with it.
    names = [name for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    heard = [number for number in map(signal.Signals.__getitem__, names) if signal.getsignal(number) != signal.SIG_IGN]
    for number in heard:  # not signals that are ignored: nohup ignores SIGHUP, shells SIGINT in background jobs
        signal.signal(number, _leave)
    from coheft.app.terminal.standard_output import guard_standard_streams

    guard_standard_streams()
    from coheft.app.cli.main import run_command_line
    from coheft.wire.process.leave import leave

    try:
        for number in heard:
            signal.signal(number, signal.default_int_handler)
        status = run_command_line(sys.argv[1:])
    except KeyboardInterrupt:  # just before or after the command handles it
        print("stopped", file=sys.stderr)
        status = _STATUS
    leave(status)


if __name__ == "__main__":
    main()

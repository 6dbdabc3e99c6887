"""The command line. Modules that only one command needs are imported in that command, so that help is fast."""

import errno
import sys
from collections.abc import Sequence

import cyclopts

from coheft.app.cli import (  # noqa: F401  # each module adds its commands to the application
    cart,
    control,
    export,
    faults,
    identify,
    mocobots,
    parts,
    recordings,
    run,
    scenarios,
    shell,
    study,
    view,
)
from coheft.app.cli.base import EXIT_ERROR, EXIT_INTERRUPTED, EXIT_USAGE, app
from coheft.app.cli.errors import complain, explain_usage
from coheft.app.terminal.standard_output import lost_output
from coheft.errors import CoheftError, ScenarioError, UsageError

for _command in app.subapps:
    if _command.name != ("run",):  # where all exit statuses occur
        _command.help_epilogue = ""


def run_command_line(arguments: Sequence[str]) -> int:
    """Run one command and return its exit status; errors are printed in one line, without a traceback."""
    status = _carry_out(arguments)
    failure = lost_output()
    if failure is None:
        return status
    if not isinstance(failure, BrokenPipeError):  # a broken pipe is normal: 'head' reads only the first lines
        reason = "it is closed" if failure.errno == errno.EBADF else failure.strerror
        complain(f"standard output: {reason}; printed text is lost")
    return status if status in (EXIT_USAGE, EXIT_INTERRUPTED) else EXIT_ERROR


def _carry_out(arguments: Sequence[str]) -> int:
    try:
        status = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
    except cyclopts.CycloptsError as error:
        return _fail(explain_usage(error), EXIT_USAGE)
    except (ScenarioError, UsageError) as error:
        return _fail(str(error), EXIT_USAGE)
    except CoheftError as error:
        return _fail(str(error), EXIT_ERROR)
    except KeyboardInterrupt as interruption:  # the message of a run names files that were not written
        print(str(interruption) or "stopped", file=sys.stderr)
        return EXIT_INTERRUPTED
    except OSError as error:  # for instance a full disk
        if error is lost_output():
            return EXIT_ERROR
        return _fail(f"{error.filename}: {error.strerror}" if error.filename else str(error), EXIT_ERROR)
    return int(status or 0)


def _fail(text: str, status: int) -> int:
    complain(text)
    return status


__all__ = ["app", "run_command_line"]

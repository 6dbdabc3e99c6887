"""The command line. Modules that only one command needs are imported in that command, so that help is fast."""

from __future__ import annotations

import errno
import re
import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import cyclopts
from cyclopts import Parameter

from coheft.app.cli import (  # noqa: F401  # each module adds its commands to the application
    cart,
    control,
    export,
    faults,
    identify,
    keys,
    mocobots,
    options,
    recover,
    report,
    ros2,
    run,
    schema,
    shell,
    study,
    view,
)
from coheft.app.cli.base import EXIT_ERROR, EXIT_INTERRUPTED, EXIT_USAGE, PARTS, RUN, app
from coheft.app.cli.errors import complain, explain_usage
from coheft.app.terminal.standard_output import lost_output
from coheft.errors import CoheftError, ScenarioError, UsageError

Config = Annotated[
    options.GivenPath, Parameter(help="Its configuration, as 'coheft run --write-configs DIR' writes it.")
]
_WIDTH = 80
"""Width of the output in columns."""


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


@app.command(group=RUN)
def scenarios() -> None:
    """List the shipped scenarios."""
    from coheft.wire.scenario.file import available_scenarios, load_scenario

    shipped = available_scenarios()
    column = max(map(len, shipped)) + 2
    for name in sorted(shipped, key=_by_number):
        text = f"{name:{column}}{load_scenario(shipped[name]).description}"
        print(textwrap.fill(text, _WIDTH, subsequent_indent=" " * column))


def _by_number(name: str) -> list[tuple[int, str]]:
    """Return a key that sorts ring3 before ring12."""
    return [(int(part), "") if part.isdigit() else (0, part) for part in re.split(r"(\d+)", name)]


@app.command(group=PARTS)
def server(config: Config) -> int:
    """Start a physics server by hand."""
    return _start_by_hand("coheft.physics_server.server", config)


@app.command(group=PARTS)
def agent(config: Config) -> int:
    """Start one robot by hand."""
    return _start_by_hand("coheft.agents.process.main", config)


def _start_by_hand(module: str, config: Path) -> int:
    from coheft.app.run.processes import run_in_foreground

    return run_in_foreground(module, config)


__all__ = ["app", "run_command_line"]

"""The command lines of benchmarks."""

import sys
from collections.abc import Callable
from typing import NoReturn

import cyclopts

from coheft.errors import CoheftError


def run_command(main: Callable[..., int | None], about: str | None) -> NoReturn:
    """Run ``main`` with the arguments of the command line, and end with its exit status; ``about`` is for its help."""
    app = cyclopts.App(help=about, help_format="plaintext", version_flags=())
    app.default(main)
    try:
        sys.exit(app(result_action="return_value"))
    except (CoheftError, OSError) as error:
        sys.exit(str(error))

"""The log of a process: one line per event on stderr, which the supervisor writes to a file."""

import logging
import sys
from typing import Literal

LOG = logging.getLogger("coheft")
"""Logger of a process of a run: warnings for problems that it survives, errors for those that end it."""
LogLevel = Literal["debug", "info", "warning", "error"]
"""The lowest level of lines that are written."""


def log_to_stderr(level: LogLevel = "info") -> None:
    """Write log records of this level or above to stderr, one line each, without prefix."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("%(message)s"))
    LOG.handlers[:] = [handler]
    LOG.propagate = False
    LOG.setLevel(level.upper())

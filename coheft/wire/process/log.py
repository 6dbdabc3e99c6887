"""The log of a process: a line for everything worth knowing, on stderr, which the supervisor writes into a file."""

from __future__ import annotations

import logging
import sys
from typing import Literal

LOG = logging.getLogger("coheft")
"""Of a process of a run: warnings for what is wrong but survived, errors for what ends it."""
LogLevel = Literal["debug", "info", "warning", "error"]
"""The least important lines that are written."""


def log_to_stderr(level: LogLevel = "info") -> None:
    """Write lines of this level or above to stderr, one for each record, as they are."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("%(message)s"))
    LOG.handlers[:] = [handler]
    LOG.propagate = False
    LOG.setLevel(level.upper())

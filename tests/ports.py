"""Ports of loopback at which tests themselves listen, or let a command listen."""

from __future__ import annotations

import os
import random
import socket
from contextlib import suppress
from itertools import cycle

# Tests that run side by side start teams with many ports: each worker has its own ones. Plans choose from the first
# 1300. The others are given to tests: a plan's processes may not yet listen at the ports that it has chosen.
_WORKER = os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")
_FIRST = 20000 + 1500 * (int(_WORKER) % 8)
PORTS_OF_PLANS = f"{_FIRST}-{_FIRST + 1299}"
_OWN = range(_FIRST + 1300, _FIRST + 1500)
_own = cycle(random.sample(_OWN, len(_OWN)))  # two runs of tests at a time rarely come to the same one


def free_port() -> int:
    """Return a port at which no process listens, which no plan chooses and none of the last calls returned."""
    for port in _own:
        with socket.socket() as candidate, suppress(OSError):
            candidate.bind(("127.0.0.1", port))
            return port
    raise AssertionError("ports are cycled without end")

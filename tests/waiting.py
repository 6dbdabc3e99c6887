"""Patience with what happens at its own time, unless something is broken."""

from __future__ import annotations

import time
from collections.abc import Callable

from coheft.wire.transport.inbox import Event, Inbox

LIMIT = 60.0
"""Nothing takes so long unless it is broken [s]."""


def wait_until(condition: Callable[[], object], what: str = "what should come", limit: float = LIMIT) -> None:
    """Poll a condition that comes true within ``limit`` [s] unless something is broken."""
    deadline = time.monotonic() + limit
    while not condition():
        assert time.monotonic() < deadline, f"waited {limit:g} s for {what}"
        time.sleep(0.01)


def next_event(inbox: Inbox) -> Event:
    """What comes next; something does unless something is broken."""
    event = inbox.receive(LIMIT)
    assert event is not None, f"waited {LIMIT:g} s in vain"
    return event

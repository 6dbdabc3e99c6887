"""End of a process that may still be closing a network session."""

import os
import sys
import threading
from typing import NoReturn

CLOSING = "closing a session"
"""Name of the threads that close sessions."""


def leave(status: int) -> NoReturn:
    """End this process with an exit status; at once if a session is still closing.

    A frozen process at the other end keeps a session from closing for up to ten seconds. If the call into Zenoh
    returned while Python shuts down, Python would end its thread in the middle of it, which aborts the process.
    """
    if any(thread.name == CLOSING for thread in threading.enumerate()):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    sys.exit(status)

"""The physics server as it is on a busy machine: when a run has failed, its agents have ended long before it."""

from __future__ import annotations

import time

from coheft.physics_server import server

LATER = 3.0
"""Longer than the supervisor waits for last words [s]."""

if __name__ == "__main__":
    try:
        server.main()
    finally:
        time.sleep(LATER)

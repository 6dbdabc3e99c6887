"""The cart's physics server as it is on a busy machine when a run has failed: its agents have ended long before it."""

from __future__ import annotations

import time

from coheft.physics_server.cart import physics, server
from tests.integration.slow_to_end_server import LATER

if __name__ == "__main__":
    physics._FARTHEST = 0.0  # out of bounds at once
    try:
        server.main()
    finally:
        time.sleep(LATER)

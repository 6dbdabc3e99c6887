"""Where the view is."""

from __future__ import annotations

import os
import socket

from coheft.errors import LinkError

PORT = 8010
"""Unless it is taken."""
_TRIED = 100


def choose_port(host: str, port: int | None) -> int:
    """A port at which somebody can listen: the one that was asked for, or else ``PORT`` or the next one that is free.

    Raises:
        LinkError: There is none.
    """
    reason = "none of them is free"
    for candidate in (port,) if port is not None else range(PORT, PORT + _TRIED):
        try:
            with socket.socket() as probe:
                if os.name == "posix":  # or a view that has just ended would keep its port for a minute
                    probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind((host, candidate))
            return candidate
        except OSError as error:
            reason = str(error.strerror)
    where = f"{host}:{port}" if port is not None else f"{host}, ports {PORT} to {PORT + _TRIED - 1}"
    raise LinkError(f"the view cannot listen at {where}: {reason}; choose others: --host, --port")

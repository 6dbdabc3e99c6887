"""viser's server, behind a door."""

from __future__ import annotations

import contextlib
import io
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import viser
import websockets.asyncio.server as sockets
from viser._messages import ShareUrlDisconnect, ShareUrlRequest

from coheft.app.view.door import Door
from coheft.app.view.ports import choose_port
from coheft.errors import CoheftError


@contextmanager
def open_server(door: Door, port: int | None) -> Iterator[viser.ViserServer]:
    """A server for browsers.

    Args:
        door: Where it listens, and who may come in.
        port: On this port; None: any that is free.

    Raises:
        LinkError: It cannot listen there.
        CoheftError: This release of viser would leave the door open.
    """
    port = choose_port(door.host, port)
    with contextlib.redirect_stdout(io.StringIO()), _behind(door) as doors:  # it would print a banner of its own
        server = viser.ViserServer(host=door.host, port=port, verbose=False)
    try:
        if not doors:
            raise CoheftError(f"viser {viser.__version__} cannot be guarded: install one that coheft knows, viser 1.1")
        for kind in (ShareUrlRequest, ShareUrlDisconnect):  # else a page could make it public, over its makers' server
            server._websock_server.unregister_handler(kind)
        yield server
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()


@contextmanager
def _behind(door: Door) -> Iterator[list[Door]]:
    """Servers that begin in this context are behind a door; yields it once for each. viser has no place for one."""
    serve, doors = sockets.serve, list[Door]()
    log = logging.Logger("view", logging.CRITICAL)  # whoever knocks with rubbish would fill the terminal

    def serve_behind(*arguments: Any, process_request: Any, **options: Any) -> Any:
        doors.append(door)
        return serve(*arguments, process_request=door.guard(process_request), logger=log, **options)

    sockets.serve = serve_behind  # type: ignore[assignment,misc]
    try:
        yield doors
    finally:
        sockets.serve = serve  # type: ignore[misc]

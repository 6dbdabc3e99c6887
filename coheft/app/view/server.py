"""viser's server, with access control."""

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
from coheft.app.view.place import Place, choose_port
from coheft.errors import CoheftError


@contextmanager
def open_server(place: Place) -> Iterator[viser.ViserServer]:
    """Run a server for browsers that have the secret of a place; ``LinkError`` if it cannot listen there."""
    port = choose_port(place.host, place.port)  # viser itself would try others
    with contextlib.redirect_stdout(io.StringIO()), _behind(Door(place)) as doors:  # viser prints a banner
        server = viser.ViserServer(host=place.host, port=port, verbose=False)
    try:
        if not doors:
            raise CoheftError(f"viser {viser.__version__} cannot be guarded: install one that coheft knows, viser 1.1")
        for kind in (ShareUrlRequest, ShareUrlDisconnect):  # otherwise a page could publish the view on viser's server
            server._websock_server.unregister_handler(kind)
        yield server
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()


@contextmanager
def _behind(door: Door) -> Iterator[list[Door]]:
    """Control access to servers that begin in this context, as viser has no option for it; yield the door of each."""
    serve, doors = sockets.serve, list[Door]()
    log = logging.Logger("view", logging.CRITICAL)  # invalid requests would fill the terminal

    def serve_behind(*arguments: Any, process_request: Any, **options: Any) -> Any:
        doors.append(door)
        return serve(*arguments, process_request=door.guard(process_request), logger=log, **options)

    sockets.serve = serve_behind  # type: ignore[assignment,misc]
    try:
        yield doors
    finally:
        sockets.serve = serve  # type: ignore[misc]

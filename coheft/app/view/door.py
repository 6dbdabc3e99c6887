"""Access control of a view, which acts with the keys of its user: it answers only clients that have a secret.

The secret is a part of the path, which page and socket share. It is not a cookie, because browsers send cookies to
every port of a host, and another user of the host may listen at one.
"""

import secrets
import socket
from collections.abc import Callable
from dataclasses import replace
from http import HTTPStatus

from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from coheft.app.view.place import Place, bracketed, is_wildcard

Answer = Callable[[ServerConnection, Request], Response | None]
"""Returns the response to a request; None to open a socket."""
_LOOPBACK = ("localhost", "127.0.0.1", "::1")
_HEADERS = {
    "Referrer-Policy": "no-referrer",
    "Content-Security-Policy": "frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}
"""Headers that keep the address and the content from other pages."""
REFUSAL = b"""<!doctype html>
<html lang="en"><meta charset="utf-8"><title>Not this way</title>
<body style="font:16px/1.5 sans-serif;max-width:40em;margin:4em auto;padding:0 1em">
<h1>This needs the whole address</h1>
<p>Open the address that stands in the terminal after <b>The view is at</b>, with the secret in it: it is where
<code>coheft run --view</code> or <code>coheft view</code> was started. Each start makes a new one.</p>
<p>Through a tunnel, take the same port at both ends.</p>
"""
"""The page for refused requests, whatever the reason, so that it reveals nothing."""


class Door:
    """Accepts requests with the secret, to an address of this view, from no other page."""

    def __init__(self, place: Place) -> None:
        self._secret = place.secret
        self._names = {*_LOOPBACK, socket.gethostname() if is_wildcard(place.host) else place.host}

    def guard(self, inner: Answer) -> Answer:
        """Return a function that answers accepted requests like ``inner``, with the secret removed from the path."""

        def answer(connection: ServerConnection, request: Request) -> Response | None:
            path = self._path_behind(connection, request)
            if path is None:
                return _refuse()
            response = inner(connection, replace(request, path=path))
            if response is not None:
                response.headers.update(_HEADERS)
            return response

        return answer

    def _path_behind(self, connection: ServerConnection, request: Request) -> str | None:
        """Return the path of a request without the secret; None if the request is refused."""
        address, port = connection.local_address[:2]
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        if len(hosts) != 1 or not self._is_ours(hosts[0], str(address), int(port)):
            return None  # a foreign name for this address (DNS rebinding)
        token, _, path = request.path.removeprefix("/").partition("/")
        if not secrets.compare_digest(_bytes(token.partition("?")[0]), _bytes(self._secret)):
            return None
        wants_socket = "Upgrade" in request.headers  # browsers always send an origin with these
        if (origins or wants_socket) and [each.lower() for each in origins] != [f"http://{hosts[0]}".lower()]:
            return None
        return f"/{path}"

    def _is_ours(self, host: str, address: str, port: int) -> bool:
        """Whether a ``Host`` header names this view: a name that others cannot assign, or the connection's address."""
        names = {bracketed(name.lower()) for name in (*self._names, address)}
        return host.lower() in {f"{name}:{port}" for name in names} | (names if port == 80 else set())


def _bytes(text: str) -> bytes:
    return text.encode(errors="surrogateescape")


def _refuse() -> Response:
    headers = Headers(_HEADERS)
    headers["Content-Type"] = "text/html; charset=utf-8"
    headers["Content-Length"] = str(len(REFUSAL))
    return Response(HTTPStatus.FORBIDDEN, "Forbidden", headers, REFUSAL)

"""Host, port and URL of the view."""

from __future__ import annotations

import os
import secrets
import socket

from coheft.errors import LinkError

PORT = 8010
"""The default port, if it is free."""
_TRIED = 100

_Place = tuple[socket.AddressFamily, str, tuple[int, ...]]
"""Address family, address, and the items after the port."""


def choose_port(host: str, port: int | None) -> int:
    """Return a free port: ``port``, or if it is None, the first free one from ``PORT`` on.

    Raises:
        LinkError: No port is free, or there is no such host.
    """
    reason = "none of them is free"
    try:
        places = _places(host)
        for candidate in (port,) if port is not None else range(PORT, PORT + _TRIED):
            try:
                _listen(places, candidate)
                return candidate
            except OSError as error:
                reason = str(error.strerror)
    except OSError as error:  # no such host, so another port would not help
        reason = str(error.strerror)
    where = f"{bracketed(host)}:{port}" if port is not None else f"{host}, ports {PORT} to {PORT + _TRIED - 1}"
    raise LinkError(f"the view cannot listen at {where}: {reason}; choose others: --host, --port")


def new_token() -> str:
    """Return a secret for one view."""
    return secrets.token_urlsafe(16)


def url(host: str, port: int, token: str) -> str:
    """Return the URL with the secret; it has this machine's name if the view listens at all addresses."""
    return f"http://{bracketed(socket.gethostname() if is_wildcard(host) else host)}:{port}/{token}/"


def is_wildcard(host: str) -> bool:
    """Whether a host means all addresses of this machine."""
    return host in ("", "0.0.0.0", "::")


def bracketed(host: str) -> str:
    """Return a host as it is written before a port."""
    return f"[{host}]" if ":" in host else host


def _places(host: str) -> list[_Place]:
    """Return all addresses of a host: the server listens at all of them."""
    found = socket.getaddrinfo(host or None, 0, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    return [(family, str(address[0]), tuple(map(int, address[2:]))) for family, _, _, _, address in found]


def _listen(places: list[_Place], port: int) -> None:
    """Try to listen at all addresses, as asyncio will; those of families without sockets on this machine are skipped.

    Raises:
        OSError: An address is not free.
    """
    unknown: OSError | None = None
    probes = 0
    for family, address, rest in places:
        try:
            probe = socket.socket(family, socket.SOCK_STREAM)
        except OSError as error:
            unknown = error
            continue
        with probe:
            probes += 1
            if os.name == "posix":  # otherwise the port of a view that has just ended is blocked for a minute
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if family == socket.AF_INET6:  # otherwise :: would include 0.0.0.0
                probe.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            probe.bind((address, port, *rest))
    if unknown is not None and not probes:
        raise unknown

"""Where the view is."""

from __future__ import annotations

import os
import secrets
import socket

from coheft.errors import LinkError

PORT = 8010
"""Unless it is taken."""
_TRIED = 100

_Place = tuple[socket.AddressFamily, str, tuple[int, ...]]
"""Family, address, and what follows the port."""


def choose_port(host: str, port: int | None) -> int:
    """A port at which somebody can listen: the one that was asked for, or else ``PORT`` or the next one that is free.

    Raises:
        LinkError: There is none.
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
    except OSError as error:  # there is no such host: another port would not help
        reason = str(error.strerror)
    where = f"{bracketed(host)}:{port}" if port is not None else f"{host}, ports {PORT} to {PORT + _TRIED - 1}"
    raise LinkError(f"the view cannot listen at {where}: {reason}; choose others: --host, --port")


def new_token() -> str:
    """A secret for one view."""
    return secrets.token_urlsafe(16)


def url(host: str, port: int, token: str) -> str:
    """Where browsers find it, with its secret; where it listens at all addresses of this machine, under its name."""
    return f"http://{bracketed(socket.gethostname() if is_wildcard(host) else host)}:{port}/{token}/"


def is_wildcard(host: str) -> bool:
    """Whether a host means all addresses of this machine."""
    return host in ("", "0.0.0.0", "::")


def bracketed(host: str) -> str:
    """A host as it stands before a port."""
    return f"[{host}]" if ":" in host else host


def _places(host: str) -> list[_Place]:
    """Every address of a host, as its server will listen at all of them."""
    found = socket.getaddrinfo(host or None, 0, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    return [(family, str(address[0]), tuple(map(int, address[2:]))) for family, _, _, _, address in found]


def _listen(places: list[_Place], port: int) -> None:
    """Try to listen, as asyncio will do: all have to be free, except where this machine has no such sockets.

    Raises:
        OSError: One is not.
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
            if os.name == "posix":  # or a view that has just ended would keep its port for a minute
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if family == socket.AF_INET6:  # or :: would want the port of 0.0.0.0 too
                probe.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            probe.bind((address, port, *rest))
    if unknown is not None and not probes:
        raise unknown

"""Where a view is: host, port and a secret."""

import asyncio
import secrets
import socket
from collections.abc import Iterable
from typing import Self

import msgspec

from coheft.errors import LinkError

PORT = 8010
"""The default port, if it is free."""
_TRIED = 100


class Place(msgspec.Struct, frozen=True):
    """Address of a view, whose URL contains the secret; the next run may have its view at the same one."""

    host: str
    port: int
    secret: str

    @classmethod
    def choose(cls, host: str, port: int | None = None) -> Self:
        """Return a place with a new secret, at a port as ``choose_port`` returns it."""
        return cls(host, choose_port(host, port), secrets.token_urlsafe(16))

    @property
    def url(self) -> str:
        """The URL; it has this machine's name if the view listens at all addresses."""
        host = socket.gethostname() if is_wildcard(self.host) else self.host
        return f"http://{bracketed(host)}:{self.port}/{self.secret}/"


def choose_port(host: str, port: int | None) -> int:
    """Return a free port, ``port`` or the first one from ``PORT`` on; ``LinkError`` if none is, or no such host."""
    try:
        return asyncio.run(_first_free(host, [port] if port is not None else range(PORT, PORT + _TRIED)))
    except OSError as error:
        where = f"{bracketed(host)}:{port}" if port is not None else f"{host}, ports {PORT} to {PORT + _TRIED - 1}"
        raise LinkError(
            f"the view cannot listen at {where}: {error.strerror}; choose others: --host, --port"
        ) from error


async def _first_free(host: str, candidates: Iterable[int]) -> int:
    """Return the first port at which a server, as viser's, can listen at all addresses of a host, or ``OSError``."""
    failure = OSError()
    for port in candidates:
        try:
            server = await asyncio.get_running_loop().create_server(
                asyncio.Protocol, host or None, port, start_serving=False
            )
        except socket.gaierror:  # no such host, so another port would not help
            raise
        except OSError as error:
            failure = error
            continue
        server.close()
        return port
    raise failure


def is_wildcard(host: str) -> bool:
    """Whether a host means all addresses of this machine."""
    return host in ("", "0.0.0.0", "::")


def bracketed(host: str) -> str:
    """Return a host as it is written before a port."""
    return f"[{host}]" if ":" in host else host

"""Host, port and URL of the view."""

import asyncio
import secrets
import socket
from collections.abc import Iterable

from coheft.errors import LinkError

PORT = 8010
"""The default port, if it is free."""
_TRIED = 100


def choose_port(host: str, port: int | None) -> int:
    """Return a free port: ``port``, or if it is None, the first free one from ``PORT`` on.

    Raises:
        LinkError: No port is free, or there is no such host.
    """
    try:
        return asyncio.run(_first_free(host, [port] if port is not None else range(PORT, PORT + _TRIED)))
    except OSError as error:
        where = f"{bracketed(host)}:{port}" if port is not None else f"{host}, ports {PORT} to {PORT + _TRIED - 1}"
        raise LinkError(
            f"the view cannot listen at {where}: {error.strerror}; choose others: --host, --port"
        ) from error


async def _first_free(host: str, candidates: Iterable[int]) -> int:
    """Return the first port at which a server, as viser's, can listen at all addresses of a host.

    Raises:
        OSError: There is none, or no such host.
    """
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

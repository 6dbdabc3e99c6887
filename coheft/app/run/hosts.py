"""Addresses of the parts of a run: on this machine, or on different hosts."""

import contextlib
import ipaddress
import os
import random
import re
import socket
import tomllib
from collections import defaultdict
from collections.abc import Iterable, Iterator
from itertools import count
from pathlib import Path
from typing import Annotated

import msgspec

from coheft.errors import LinkError, ScenarioError, file_errors
from coheft.wire.scenario.errors import explain
from coheft.wire.scenario.schema import Scenario
from coheft.wire.scenario.toml_value import as_toml
from coheft.wire.transport.planes import SERVER

_LARGEST_PORT = 65535
LOOPBACK = "127.0.0.1"
_PORTS = range(20000, 32768)
"""Above 32767 the system might assign a port to an outgoing connection before it is used here."""


class Hosts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Hosts of the parts, read from a TOML file.

    Attributes:
        hosts: Address or host name by part: ``server``, and robots by name; other parts are on the server's host.
        port: The first port that is used on every host; the others follow.
    """

    hosts: dict[str, str]
    port: Annotated[int, msgspec.Meta(ge=1, le=65535)] = 20000

    def of(self, name: str) -> str:
        """Return the host of a part, with one name for this machine, so that its ports are counted once."""
        host = self.hosts.get(name, self.hosts.get(SERVER, LOOPBACK))
        return LOOPBACK if host == "localhost" else host

    @property
    def are_remote(self) -> bool:
        """Whether any part is on another machine or reachable from one."""
        return not all(_is_loopback(host) for host in self.hosts.values())


def places_on(hosts: Hosts, names: Iterable[str]) -> Iterator[str]:
    """Yield a new ``host:port`` for each part that is named: consecutive ports, so that a firewall can be configured.

    It raises a ``LinkError`` if there is no port left.
    """
    ports: defaultdict[str, count[int]] = defaultdict(lambda: count(hosts.port))
    for name in names:
        host = hosts.of(name)
        port = next(ports[host])
        if port > _LARGEST_PORT:
            raise LinkError(f"{host} has no port left for {name}: choose a lower one than port = {hosts.port}")
        yield f"{f'[{host}]' if ':' in host else host}:{port}"


def load_hosts(path: Path, scenario: Scenario) -> Hosts:
    """Read the hosts of the parts of a scenario, or raise a ``ScenarioError``."""
    table: dict[str, object] = {}
    try:
        with file_errors(ScenarioError, f"{path}: cannot be read"):
            table = tomllib.loads(path.read_text(encoding="utf-8-sig"))
        hosts = msgspec.convert(table, Hosts)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{path}: not valid TOML: {error}") from error
    except msgspec.ValidationError as error:
        raise ScenarioError(f"{path}: {explain(error, table, Hosts)}") from error
    parts = (SERVER, *scenario.robot_names)
    unknown = sorted(hosts.hosts.keys() - set(parts))
    if unknown:
        raise ScenarioError(f"{path}: key 'hosts.{unknown[0]}': no such part; available: {', '.join(parts)}")
    for part, host in hosts.hosts.items():
        if not _is_host(host):
            raise ScenarioError(
                f"{path}: key 'hosts.{part}': found {as_toml(host)}, expected an address, such as 192.168.0.7, or a "
                f"host name"
            )
    local = [part for part in parts if _is_loopback(hosts.of(part))]
    if hosts.are_remote and local:
        raise ScenarioError(
            f"{path}: {local[0]} is on {hosts.of(local[0])}, which other hosts cannot reach: use the address that they "
            f"dial, of the server first"
        )
    return hosts


def free_ports(number: int) -> list[int]:
    """Return different ports of the loopback interface at which no process listens now, or raise a ``LinkError``.

    The environment variable ``COHEFT_PORTS`` may restrict the range, such as ``21000-21999``: two runs that start at
    the same moment could otherwise choose the same port.
    """
    ports, found = _usable_ports(), list[int]()
    for port in random.sample(ports, len(ports)):
        if len(found) == number:
            break
        with socket.socket() as candidate, contextlib.suppress(OSError):
            candidate.bind((LOOPBACK, port))
            found.append(port)
    if len(found) < number:
        raise LinkError(f"found {len(found)} free ports from {ports[0]} to {ports[-1]}, but the run needs {number}")
    return found


def _usable_ports() -> range:
    """Return the range in ``COHEFT_PORTS``, or all ports that are commonly free."""
    chosen = os.environ.get("COHEFT_PORTS", "")
    if not chosen:
        return _PORTS
    found = re.fullmatch(r"(\d{1,5})-(\d{1,5})", chosen)
    first, last = map(int, found.groups()) if found else (0, 0)
    if not 1024 <= first <= last <= _LARGEST_PORT:
        raise LinkError(f"COHEFT_PORTS is {chosen!r}, expected two ports from 1024 on, such as 21000-21999")
    return range(first, last + 1)


def _is_host(host: str) -> bool:
    try:
        ipaddress.ip_address(host)
    except ValueError:
        is_invalid_address = host.replace(".", "").isdigit()  # such as 10.0.0.300
        return not is_invalid_address and re.fullmatch(r"[A-Za-z0-9]([A-Za-z0-9_.-]*[A-Za-z0-9])?", host) is not None
    return True


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"

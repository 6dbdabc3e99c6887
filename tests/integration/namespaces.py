"""Hosts on one machine: a network namespace each, all on one bridge.

Nothing of it is visible from outside, and nothing is left when the processes that hold the namespaces have ended.
"""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import pytest

_SUBNET = "10.87.0"


@dataclass(frozen=True)
class Host:
    """A namespace with one network card, ``eth0``.

    Attributes:
        address: Of its card.
        holder: Process that lives in the namespace as long as it is needed.
    """

    address: str
    holder: int

    def command(self, *arguments: str) -> list[str]:
        """The command that runs in this host."""
        return _inside(self.holder, *arguments)

    def set_link(self, state: str) -> None:
        """Pull the plug, ``down``, or put it in, ``up``."""
        _run(self.command("ip", "link", "set", "eth0", state))


@contextmanager
def hosts(count: int) -> Iterator[list[Host]]:
    """So many hosts; the test is skipped, with the reason, where they may not be made."""
    with ExitStack() as stack:
        world = stack.enter_context(_holder(["unshare", "--user", "--map-root-user", "--net"]))
        try:
            _run(_inside(world, "ip", "link", "add", "bridge", "type", "bridge"))
            _run(_inside(world, "ip", "link", "set", "bridge", "up"))
            made = [Host(f"{_SUBNET}.{index}", _make_host(stack, world, index)) for index in range(1, count + 1)]
        except (OSError, subprocess.CalledProcessError) as error:
            reason = getattr(error, "stderr", "") or str(error)
            pytest.skip(f"cannot make network namespaces here: {reason.strip()}")
        yield made


def _make_host(stack: ExitStack, world: int, index: int) -> int:
    holder = stack.enter_context(_holder(_inside(world, "unshare", "--net")))
    port = f"port{index}"
    for command in (
        ["ip", "link", "add", port, "type", "veth", "peer", "name", "eth0", "netns", str(holder)],
        ["ip", "link", "set", port, "master", "bridge", "up"],
    ):
        _run(_inside(world, *command))
    for command in (
        ["ip", "address", "add", f"{_SUBNET}.{index}/24", "dev", "eth0"],
        ["ip", "link", "set", "eth0", "up"],
        ["ip", "link", "set", "lo", "up"],
    ):
        _run(_inside(holder, *command))
    return holder


@contextmanager
def _holder(command: Sequence[str]) -> Iterator[int]:
    """A process that does nothing in namespaces of its own until the end of the context."""
    script = "echo here; exec cat"
    try:
        process = subprocess.Popen(
            [*command, "sh", "-c", script],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
    except OSError as error:
        pytest.skip(f"cannot make network namespaces here: {error}")
    with process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        try:
            if process.stdout.readline() != "here\n":
                pytest.skip(f"cannot make network namespaces here: {process.stderr.read().strip()}")
            yield process.pid
        finally:
            process.stdin.close()


def _inside(holder: int, *command: str) -> list[str]:
    namespaces = ["--user", "--net", "--preserve-credentials"]
    return ["nsenter", "--target", str(holder), *namespaces, *command]


def _run(command: Sequence[str]) -> None:
    subprocess.run(command, check=True, capture_output=True, text=True, env={**os.environ, "LC_ALL": "C"})

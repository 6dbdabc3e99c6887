"""A team that does nothing but say as many bytes: Zenoh sessions and two loops, none of the product's processes.

``python -m benchmarks.raw_team`` reads one line of JSON from stdin, a ``RawServer`` or a ``RawAgent``. The server then
reads a number of seconds per line, runs so long in lockstep, and answers with a line: blocks and seconds.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import msgspec
import psutil
import zenoh

from benchmarks.paced_team import Turn
from coheft.app.plan import Plan
from coheft.wire.config import Neighbour
from coheft.wire.transport import open_session

_POLL = 0.01


class Sizes(msgspec.Struct, frozen=True):
    """Of the messages of one block [B]: measurements, to each neighbour, and the answer."""

    measurements: int
    message: int
    reference: int


class RawServer(msgspec.Struct, frozen=True, tag=True):
    """The server: where each robot dials in, and how many blocks it may be ahead."""

    run: str
    robots: dict[str, str]
    lookahead: int
    sizes: Sizes


class RawAgent(msgspec.Struct, frozen=True, tag=True):
    """An agent: its name, and its links as in ``AgentProcessConfig``."""

    run: str
    name: str
    server: str
    listen: str
    neighbours: tuple[Neighbour, ...]
    sizes: Sizes


class RawTeam:
    """Running processes, see ``raw_team``."""

    def __init__(self, server: subprocess.Popen[str], agents: dict[str, subprocess.Popen[str]]) -> None:
        self._server = server
        self._children = {name: psutil.Process(child.pid) for name, child in {"server": server, **agents}.items()}

    def turn(self, seconds: float) -> Turn:
        """Let it run for so long [s]."""
        assert self._server.stdin is not None
        assert self._server.stdout is not None
        before = self._cpu()
        print(seconds, file=self._server.stdin, flush=True)
        blocks, wall = self._server.stdout.readline().split()
        cpu = {name: now - before[name] for name, now in self._cpu().items()}
        return Turn(first=0, blocks=int(blocks), wall=float(wall), cpu=cpu)

    def _cpu(self) -> dict[str, float]:
        times = {name: child.cpu_times() for name, child in self._children.items()}
        return {name: each.user + each.system for name, each in times.items()}


@contextmanager
def raw_team(plan: Plan, sizes: Sizes) -> Iterator[RawTeam]:
    """Start one with the links of a plan."""
    lookahead = plan.server.scenario.lookahead
    configs: dict[str, RawServer | RawAgent] = {
        name: RawAgent(plan.run, name, agent.server, agent.listen, agent.neighbours, sizes)
        for name, agent in plan.agents.items()
    }
    with ExitStack() as stack:

        def start(config: RawServer | RawAgent) -> subprocess.Popen[str]:
            child = subprocess.Popen(
                [sys.executable, "-m", "benchmarks.raw_team"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                start_new_session=True,
            )
            stack.enter_context(child)  # closes its stdin, whose end tells it to go, and waits
            assert child.stdin is not None
            print(msgspec.json.encode(config).decode(), file=child.stdin, flush=True)
            return child

        server = start(RawServer(plan.run, plan.server.robots, lookahead, sizes))
        yield RawTeam(server, {name: start(config) for name, config in configs.items()})


class _Link:
    """Says bytes under one key on a session, and hears those under another."""

    def __init__(self, session: zenoh.Session, says: str, hears: str | None) -> None:
        self._publisher = session.declare_publisher(
            says, congestion_control=zenoh.CongestionControl.BLOCK, express=True
        )
        self._heard = session.declare_subscriber(hears, zenoh.handlers.FifoChannel(64)) if hears else None

    def wait(self) -> None:
        """Until somebody listens."""
        status: Any = self._publisher.matching_status
        while not status.matching:
            time.sleep(_POLL)
            status = self._publisher.matching_status

    def say(self, data: bytes) -> None:
        """Say it."""
        self._publisher.put(data)

    def hear(self) -> None:
        """Wait for the next."""
        assert self._heard is not None
        self._heard.recv().payload.to_bytes()


def _run_server(config: RawServer, stack: ExitStack) -> None:
    links = [
        _Link(stack.enter_context(open_session([endpoint])), f"{config.run}/down/{name}", f"{config.run}/up/{name}")
        for name, endpoint in config.robots.items()
    ]
    for link in links:
        link.wait()
        link.hear()
    data = bytes(config.sizes.measurements)
    for line in sys.stdin:
        began, seconds, sent, answered = time.monotonic(), float(line), 0, 0
        while answered < sent or time.monotonic() < began + seconds:
            is_over = time.monotonic() >= began + seconds
            if not is_over and sent < answered + config.lookahead:
                for link in links:
                    link.say(data)
                sent += 1
                continue
            for link in links:
                link.hear()
            answered += 1
        print(sent, time.monotonic() - began, flush=True)


def _run_agent(config: RawAgent, stack: ExitStack) -> None:
    def key(name: str) -> str:
        return f"{config.run}/agent/{name}"

    server_session = stack.enter_context(open_session(connect=[config.server]))
    server = _Link(server_session, f"{config.run}/up/{config.name}", f"{config.run}/down/{config.name}")
    dialled_in = stack.enter_context(open_session([config.listen]))
    all_links: list[_Link] = []
    for other in config.neighbours:
        session = dialled_in if other.endpoint is None else stack.enter_context(open_session(connect=[other.endpoint]))
        all_links.append(_Link(session, f"{key(config.name)}/{other.name}", f"{key(other.name)}/{config.name}"))
    for link in [server, *all_links]:
        link.wait()
    server.say(b"ready")
    message, reference = bytes(config.sizes.message), bytes(config.sizes.reference)
    is_first = True
    while True:
        server.hear()
        for link in all_links if not is_first else ():
            link.hear()
        for link in all_links:
            link.say(message)
        server.say(reference)
        is_first = False


def main() -> None:
    """Run what stdin says, until its end."""
    config = msgspec.json.decode(sys.stdin.readline(), type=RawServer | RawAgent)
    with ExitStack() as stack:
        if isinstance(config, RawServer):
            _run_server(config, stack)
        else:
            threading.Thread(target=_leave_with_stdin, daemon=True).start()
            _run_agent(config, stack)


def _leave_with_stdin() -> None:
    sys.stdin.read()
    os._exit(0)


if __name__ == "__main__":
    main()

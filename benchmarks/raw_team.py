"""A team that does nothing but say as many bytes: Zenoh sessions and two loops, none of the product's processes.

``python -m benchmarks.raw_team`` reads one line of JSON from stdin, a ``RawServer`` or a ``RawAgent``. The server then
reads a number of seconds per line, runs so long in lockstep, and answers with a line: blocks and seconds. Both end with
stdin.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from queue import SimpleQueue
from typing import Any

import msgspec
import psutil
import zenoh

from benchmarks.paced_team import Turn
from coheft.app.run.plan import Plan
from coheft.errors import LinkError
from coheft.wire.config import Neighbour
from coheft.wire.transport.sessions import open_session

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
    """Running processes by name (``server`` is one of them), see ``raw_team``."""

    def __init__(self, processes: dict[str, subprocess.Popen[str]]) -> None:
        self.processes = processes
        self._children = {name: psutil.Process(process.pid) for name, process in processes.items()}

    def turn(self, seconds: float) -> Turn:
        """Let it run for so long [s].

        Raises:
            LinkError: The server has ended.
        """
        server = self.processes["server"]
        assert server.stdin is not None
        assert server.stdout is not None
        before = self._cpu()
        with suppress(BrokenPipeError):  # then there is no answer
            print(seconds, file=server.stdin, flush=True)
        answer = server.stdout.readline().split()
        if not answer:
            raise LinkError(f"the server has ended, with status {server.wait()}: what it said is above")
        blocks, wall = answer
        cpu = {name: now - before[name] for name, now in self._cpu().items()}
        return Turn(first=0, blocks=int(blocks), wall=float(wall), cpu=cpu)

    def _cpu(self) -> dict[str, float]:
        times = {name: child.cpu_times() for name, child in self._children.items()}
        return {name: each.user + each.system for name, each in times.items()}


@contextmanager
def raw_team(plan: Plan, sizes: Sizes) -> Iterator[RawTeam]:
    """Start one with the links of a plan."""
    lookahead = plan.server.scenario.lookahead
    configs = {
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
            stack.callback(_end, child)
            assert child.stdin is not None
            print(msgspec.json.encode(config).decode(), file=child.stdin, flush=True)
            return child

        server = start(RawServer(plan.run, plan.server.robots, lookahead, sizes))
        yield RawTeam({"server": server, **{name: start(config) for name, config in configs.items()}})


def _end(child: subprocess.Popen[str]) -> None:
    """Kill a process, and wait until it is gone."""
    with suppress(BrokenPipeError), child:  # it may not have read all
        child.kill()


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


def _run_server(config: RawServer, turns: SimpleQueue[float], stack: ExitStack) -> None:
    links = [
        _Link(stack.enter_context(open_session([endpoint])), f"{config.run}/down/{name}", f"{config.run}/up/{name}")
        for name, endpoint in config.robots.items()
    ]
    for link in links:
        link.wait()
        link.hear()
    data = bytes(config.sizes.measurements)
    while True:
        seconds = turns.get()
        began, sent, answered = time.monotonic(), 0, 0
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
    turns: SimpleQueue[float] = SimpleQueue()
    threading.Thread(target=_read_turns, args=(turns,), daemon=True).start()
    with ExitStack() as stack:
        if isinstance(config, RawServer):
            _run_server(config, turns, stack)
        else:
            _run_agent(config, stack)


def _read_turns(turns: SimpleQueue[float]) -> None:
    """Hand on how long the server shall run, each time; leave at once when stdin ends."""
    for line in sys.stdin:
        turns.put(float(line))
    os._exit(0)


if __name__ == "__main__":
    main()

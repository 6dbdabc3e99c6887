"""A team that does nothing but say as many bytes: Zenoh sessions and two loops, none of the product's processes."""

from __future__ import annotations

import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Any

import psutil
import zenoh

from benchmarks.paced_team import Turn
from coheft.app.run.plan import Plan
from coheft.errors import LinkError
from coheft.wire.config import AgentProcessConfig
from coheft.wire.transport.sessions import open_session

_POLL = 0.01
_SPAWN = multiprocessing.get_context("spawn")


@dataclass(frozen=True)
class Sizes:
    """Of the messages of one block [B]: measurements, to each neighbour, and the answer."""

    measurements: int
    message: int
    reference: int


class RawTeam:
    """Running processes by name (``server`` is one of them), see ``raw_team``; the server is told of turns."""

    def __init__(self, processes: dict[str, SpawnProcess], turns: Connection[float, tuple[int, float]]) -> None:
        self.processes = processes
        self._turns = turns
        self._children = {name: psutil.Process(process.pid) for name, process in processes.items()}

    def turn(self, seconds: float) -> Turn:
        """Let it run for so long [s].

        Raises:
            LinkError: The server has ended.
        """
        before = self._cpu()
        try:
            self._turns.send(seconds)
            blocks, wall = self._turns.recv()
        except (EOFError, OSError) as error:
            server = self.processes["server"]
            server.join()
            raise LinkError(f"the server has ended, with status {server.exitcode}: what it said is above") from error
        cpu = {name: now - before[name] for name, now in self._cpu().items()}
        return Turn(first=0, blocks=blocks, wall=wall, cpu=cpu)

    def _cpu(self) -> dict[str, float]:
        times = {name: child.cpu_times() for name, child in self._children.items()}
        return {name: each.user + each.system for name, each in times.items()}


@contextmanager
def raw_team(plan: Plan, sizes: Sizes) -> Iterator[RawTeam]:
    """Start one with the links of a plan."""
    with ExitStack() as stack:

        def start(run: Callable[..., None], *arguments: object) -> SpawnProcess:
            child = _SPAWN.Process(target=_alone, args=(run, *arguments), daemon=True)
            child.start()
            stack.callback(child.join)
            stack.callback(child.kill)
            return child

        ours, theirs = _SPAWN.Pipe()
        lookahead = plan.server.scenario.lookahead
        processes = {"server": start(_run_server, plan.run, plan.server.robots, lookahead, sizes, theirs)}
        theirs.close()  # or its end would not be noticed
        processes |= {name: start(_run_agent, config, sizes) for name, config in plan.agents.items()}
        yield RawTeam(processes, ours)


def _alone(run: Callable[..., None], *arguments: object) -> None:
    """Run a part, in a session of its own as the product's, as long as whoever has started it is there."""
    os.setsid()
    parent = multiprocessing.parent_process()
    assert parent is not None
    threading.Thread(target=_leave_with, args=(parent.sentinel,), daemon=True).start()
    with ExitStack() as stack:
        run(stack, *arguments)


def _leave_with(sentinel: int) -> None:
    multiprocessing.connection.wait([sentinel])
    os._exit(0)


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


def _run_server(
    stack: ExitStack,
    run: str,
    robots: dict[str, str],
    lookahead: int,
    sizes: Sizes,
    turns: Connection[tuple[int, float], float],
) -> None:
    """Run for as many seconds as it is told, each time, and answer with blocks and seconds."""
    links = [
        _Link(stack.enter_context(open_session([endpoint])), f"{run}/down/{name}", f"{run}/up/{name}")
        for name, endpoint in robots.items()
    ]
    for link in links:
        link.wait()
        link.hear()
    data = bytes(sizes.measurements)
    while True:
        seconds = turns.recv()
        began, sent, answered = time.monotonic(), 0, 0
        while answered < sent or time.monotonic() < began + seconds:
            is_over = time.monotonic() >= began + seconds
            if not is_over and sent < answered + lookahead:
                for link in links:
                    link.say(data)
                sent += 1
                continue
            for link in links:
                link.hear()
            answered += 1
        turns.send((sent, time.monotonic() - began))


def _run_agent(stack: ExitStack, config: AgentProcessConfig, sizes: Sizes) -> None:
    """Answer the server, block after block."""
    run, own = config.run, config.agent.name
    server_session = stack.enter_context(open_session(connect=[config.server]))
    server = _Link(server_session, f"{run}/up/{own}", f"{run}/down/{own}")
    dialled_in = stack.enter_context(open_session([config.listen]))
    all_links: list[_Link] = []
    for other in config.neighbours:
        session = dialled_in if other.endpoint is None else stack.enter_context(open_session(connect=[other.endpoint]))
        all_links.append(_Link(session, f"{run}/agent/{own}/{other.name}", f"{run}/agent/{other.name}/{own}"))
    for link in [server, *all_links]:
        link.wait()
    server.say(b"ready")
    message, reference = bytes(sizes.message), bytes(sizes.reference)
    is_first = True
    while True:
        server.hear()
        for link in all_links if not is_first else ():
            link.hear()
        for link in all_links:
            link.say(message)
        server.say(reference)
        is_first = False

"""Zenoh alone: sessions and two loops that send as many bytes as a team, without the product's processes."""

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

from benchmarks.paced_team import Turn, cpu_times
from coheft.app.run.plan import Plan
from coheft.errors import LinkError
from coheft.wire.config import AgentProcessConfig
from coheft.wire.transport.sessions import open_session

_POLL = 0.01
_SPAWN = multiprocessing.get_context("spawn")


@dataclass(frozen=True)
class Sizes:
    """Sizes of the messages of a block [B]: measurements, message to each neighbour, reference."""

    measurements: int
    message: int
    reference: int


class RawTeam:
    """Running processes by name, including ``server``, see ``raw_team``."""

    def __init__(self, processes: dict[str, SpawnProcess], turns: Connection[float, tuple[int, float]]) -> None:
        self.processes = processes
        self._turns = turns
        self._children = {name: psutil.Process(process.pid) for name, process in processes.items()}

    def turn(self, seconds: float) -> Turn:
        """Run for a time [s]; raise ``LinkError`` if the server has ended."""
        before = cpu_times(self._children)
        try:
            self._turns.send(seconds)
            blocks, wall = self._turns.recv()
        except (EOFError, OSError) as error:
            server = self.processes["server"]
            server.join()
            raise LinkError(f"the server has ended, with status {server.exitcode}: its output is above") from error
        cpu = {name: now - before[name] for name, now in cpu_times(self._children).items()}
        return Turn(blocks=blocks, wall=wall, cpu=cpu)


@contextmanager
def raw_team(plan: Plan, sizes: Sizes) -> Iterator[RawTeam]:
    """Start a team with the links of a plan."""
    with ExitStack() as stack:

        def start(run: Callable[..., None], *arguments: object) -> SpawnProcess:
            child = _SPAWN.Process(target=_alone, args=(run, *arguments), daemon=True)
            child.start()
            stack.callback(child.join)
            stack.callback(child.kill)
            return child

        ours, theirs = _SPAWN.Pipe()
        lookahead = plan.server.scenario.lookahead
        processes = {"server": start(_run_server, plan.server.run, plan.server.robots, lookahead, sizes, theirs)}
        theirs.close()  # otherwise its end would not be noticed
        processes |= {name: start(_run_agent, config, sizes) for name, config in plan.agents.items()}
        yield RawTeam(processes, ours)


def _alone(run: Callable[..., None], *arguments: object) -> None:
    """Run a part in a separate session, like the product's, until its parent ends."""
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
    """Sends bytes under one key of a session, and receives those under another."""

    def __init__(self, session: zenoh.Session, sends: str, receives: str) -> None:
        self._publisher: Any = session.declare_publisher(
            sends, congestion_control=zenoh.CongestionControl.BLOCK, express=True
        )
        self._received = session.declare_subscriber(receives, zenoh.handlers.FifoChannel(64))

    def wait(self) -> None:
        """Wait until the other end listens."""
        while not self._publisher.matching_status.matching:
            time.sleep(_POLL)

    def send(self, data: bytes) -> None:
        """Send bytes."""
        self._publisher.put(data)

    def receive(self) -> None:
        """Wait for the next message."""
        self._received.recv().payload.to_bytes()


def _run_server(
    stack: ExitStack,
    run: str,
    robots: dict[str, str],
    lookahead: int,
    sizes: Sizes,
    turns: Connection[tuple[int, float], float],
) -> None:
    """Run for each requested time [s], and answer with the numbers of blocks and seconds."""
    links = [
        _Link(stack.enter_context(open_session([endpoint])), f"{run}/down/{name}", f"{run}/up/{name}")
        for name, endpoint in robots.items()
    ]
    for link in links:
        link.wait()
        link.receive()
    data = bytes(sizes.measurements)
    while True:
        seconds = turns.recv()
        began, sent, answered = time.monotonic(), 0, 0
        while answered < sent or time.monotonic() < began + seconds:
            is_over = time.monotonic() >= began + seconds
            if not is_over and sent < answered + lookahead:
                for link in links:
                    link.send(data)
                sent += 1
                continue
            for link in links:
                link.receive()
            answered += 1
        turns.send((sent, time.monotonic() - began))


def _run_agent(stack: ExitStack, config: AgentProcessConfig, sizes: Sizes) -> None:
    """Answer the server in each block."""
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
    server.send(b"ready")
    message, reference = bytes(sizes.message), bytes(sizes.reference)
    is_first = True
    while True:
        server.receive()
        for link in all_links if not is_first else ():
            link.receive()
        for link in all_links:
            link.send(message)
        server.send(reference)
        is_first = False

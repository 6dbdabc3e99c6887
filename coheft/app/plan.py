"""Who runs with which configuration: everything about a run that is decided before its first process starts."""

from __future__ import annotations

import contextlib
import random
import secrets
import socket
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import msgspec

from coheft.app.run_folder import RUN_FILE, RunFile
from coheft.errors import LinkError
from coheft.wire.config import AgentProcessConfig, Neighbour, ServerConfig, agent_config
from coheft.wire.scenario import Scenario
from consensus.graph import build_graph

Clock = Literal["lockstep", "realtime"]

_HOST = "127.0.0.1"
_PORTS = range(20000, 32768)
"""Above 32767 the system may give a port to an outgoing connection between our choice and its use."""


@dataclass(frozen=True)
class Plan:
    """Configurations of all processes of a run.

    Attributes:
        server: The physics server's.
        agents: The agents', by name.
    """

    server: ServerConfig
    agents: dict[str, AgentProcessConfig]

    @property
    def run(self) -> str:
        """Prefix of all keys of the run."""
        return self.server.run

    def run_file(self) -> RunFile:
        """How to reach the run."""
        agents = {name: agent.observe for name, agent in self.agents.items()}
        return RunFile(run=self.run, server=self.server.observe, agents=agents)

    def write(self, folder: Path) -> list[Path]:
        """Write each configuration to a file of its own, so that the parts can be started by hand.

        The folder also gets the file by which ``coheft watch --run FOLDER`` and its like find the run.
        """
        folder.mkdir(parents=True, exist_ok=True)
        (folder / RUN_FILE).write_bytes(msgspec.json.encode(self.run_file()))
        configs: dict[str, msgspec.Struct] = {"server": self.server, **self.agents}
        paths = []
        for name, config in configs.items():
            paths.append(folder / f"{name}.json")
            paths[-1].write_bytes(msgspec.json.format(msgspec.json.encode(config)) + b"\n")
        return paths


def make_plan(scenario: Scenario, clock: Clock = "lockstep", save_data: Path | None = None) -> Plan:
    """Draw the graph, find ports, give the run a name of its own; the server saves all measurements if told where.

    Along an edge the robot that comes first listens, and the other one dials.

    Raises:
        LinkError: There are not enough free ports.
    """
    names = scenario.robot_names
    graph = build_graph(scenario.graph, names)
    endpoints = iter([f"tcp/{_HOST}:{port}" for port in free_ports(3 * len(names) + 1)])
    run = f"coheft-{secrets.token_hex(4)}"
    observe = next(endpoints)
    robots = {name: next(endpoints) for name in names}
    listen = {name: next(endpoints) for name in names}
    return Plan(
        server=ServerConfig(
            scenario=scenario,
            run=run,
            robots=robots,
            observe=observe,
            neighbours=graph,
            clock=clock,
            save_data=None if save_data is None else str(save_data.absolute()),
        ),
        agents={
            name: AgentProcessConfig(
                agent=agent_config(scenario, name, graph[name]),
                run=run,
                server=robots[name],
                listen=listen[name],
                observe=next(endpoints),
                neighbours=tuple(
                    Neighbour(name=other, endpoint=listen[other] if names.index(other) < names.index(name) else None)
                    for other in graph[name]
                ),
            )
            for name in names
        },
    )


def free_ports(count: int) -> list[int]:
    """Different ports of the loopback interface on which nobody listens now.

    Raises:
        LinkError: There are not enough.
    """
    found: list[int] = []
    with contextlib.ExitStack() as held:
        for port in random.sample(_PORTS, len(_PORTS)):
            if len(found) == count:
                break
            candidate = held.enter_context(socket.socket())
            try:
                candidate.bind((_HOST, port))
            except OSError:
                continue
            found.append(port)
    if len(found) < count:
        raise LinkError(f"found {len(found)} free ports from {_PORTS[0]} to {_PORTS[-1]}, but the run needs {count}")
    return found

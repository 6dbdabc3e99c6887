"""Who runs with which configuration: everything about a run that is decided before its first process starts."""

from __future__ import annotations

import os
import secrets
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from coheft.app.run.folder import RUN_FILE, RunFile
from coheft.app.run.hosts import FreePorts, HostPorts, Hosts, Places
from coheft.consensus.graph import build_graph
from coheft.errors import CoheftError
from coheft.wire.config import AgentProcessConfig, ClockKind, Neighbour, ServerConfig, agent_config
from coheft.wire.messages.size import largest_arrays, message_limit
from coheft.wire.process.log import LogLevel
from coheft.wire.scenario.schema import Scenario
from coheft.wire.transport.planes import SERVER
from coheft.wire.transport.security import Credentials, credentials_in


@dataclass(frozen=True)
class Plan:
    """Configurations of all processes of a run.

    Attributes:
        server: The physics server's.
        agents: The agents', by name.
        keys: Folder with everyone's credentials; None: the open profile.
        began: When it was made, seconds since 1970.
    """

    server: ServerConfig
    agents: dict[str, AgentProcessConfig]
    keys: Path | None = None
    began: float = field(default_factory=time.time)

    @property
    def run(self) -> str:
        """Prefix of all keys of the run."""
        return self.server.run

    def run_file(self) -> RunFile:
        """How to reach the run."""
        agents = {name: agent.observe for name, agent in self.agents.items()}
        keys = str(self.keys.resolve()) if self.keys is not None else None
        return RunFile(run=self.run, server=self.server.observe, agents=agents, keys=keys, began=self.began)

    def write(self, folder: Path) -> list[Path]:
        """Write each configuration to a file of its own, so that the parts can be started by hand.

        The folder also gets the file by which ``coheft watch --run FOLDER`` and its like find the run. Paths of keys
        are written as seen from the folder.
        """
        folder.mkdir(parents=True, exist_ok=True)
        keys = os.path.relpath(self.keys.resolve(), folder.resolve()) if self.keys is not None else None
        (folder / RUN_FILE).write_bytes(msgspec.json.encode(msgspec.structs.replace(self.run_file(), keys=keys)))
        paths = []
        configs: dict[str, ServerConfig | AgentProcessConfig] = {SERVER: self.server, **self.agents}
        for name, config in configs.items():
            paths.append(folder / f"{name}.json")
            paths[-1].write_bytes(msgspec.json.format(msgspec.json.encode(_seen_from(folder, config))) + b"\n")
        return paths


def check_no_parts(folder: Path, scenario: Scenario) -> None:
    """Check that no configuration would be overwritten: parts of two runs in one folder do not find each other.

    Raises:
        CoheftError: There is one.
    """
    for name in (RUN_FILE, *(f"{part}.json" for part in (SERVER, *scenario.robot_names))):
        if (folder / name).exists():
            raise CoheftError(
                f"{folder / name} is there already: configurations are never overwritten; name another folder"
            )


def make_plan(
    scenario: Scenario,
    clock: ClockKind = "lockstep",
    *,
    run: str | None = None,
    hosts: Hosts | None = None,
    keys: Path | None = None,
    save_data: Path | None = None,
    log_level: LogLevel = "info",
) -> Plan:
    """Draw the graph and give every part its endpoints.

    Args:
        scenario: What to run.
        clock: Whether to wait for slow robots.
        run: Name of the run; a new one by default.
        hosts: Where each part runs; None: all on free ports of this machine's loopback interface.
        keys: Folder with everyone's credentials, see ``coheft.app.run.keys``; None: the open profile.
        save_data: File for what all robots measure; None: nothing is kept.
        log_level: What the logs of all processes have at least.

    Raises:
        LinkError: There are not enough free ports.
        CoheftError: Credentials are missing, or the open profile would be open to other machines.
    """
    names = scenario.robot_names
    graph = build_graph(scenario.graph, names)
    if keys is None and hosts is not None and hosts.are_remote:
        raise CoheftError("across hosts everyone could dial in, and say anything: add --secure")
    places: Places = HostPorts(hosts) if hosts is not None else FreePorts(3 * len(names) + 1)

    def take(name: str) -> str:
        return f"{'tls' if keys is not None else 'tcp'}/{places.take(name)}"

    def credentials(name: str) -> Credentials | None:
        return credentials_in(keys, name) if keys is not None else None

    run = run or new_run_name()
    # In real time, who waits longer than that is too late with its own reference.
    patience = {} if clock != "realtime" else {"patience": scenario.lookahead * scenario.block_duration}
    observe = take(SERVER)
    robots = {name: take(SERVER) for name in names}
    listen = {name: take(name) for name in names}
    return Plan(
        server=ServerConfig(
            scenario=scenario,
            run=run,
            robots=robots,
            observe=observe,
            neighbours=graph,
            clock=clock,
            save_data=None if save_data is None else str(save_data.absolute()),
            security=credentials(SERVER),
            log_level=log_level,
        ),
        agents={
            name: AgentProcessConfig(
                agent=agent_config(scenario, name, graph[name]),
                run=run,
                server=robots[name],
                listen=listen[name],
                observe=take(name),
                neighbours=link_neighbours(name, graph[name], listen),
                security=credentials(name),
                largest_message=message_limit(scenario),
                largest_arrays=largest_arrays(scenario),
                log_level=log_level,
                **patience,
            )
            for name in names
        },
        keys=keys,
    )


def link_neighbours(name: str, others: Iterable[str], listen: Mapping[str, str]) -> tuple[Neighbour, ...]:
    """How a robot reaches its neighbours: along an edge the robot that comes first listens, and the other one dials.

    Args:
        name: The robot's.
        others: Its neighbours' names.
        listen: Where each robot of the team listens for neighbours, in the team's order.
    """
    order = list(listen)
    dialled = order[: order.index(name)]
    return tuple(Neighbour(name=other, endpoint=listen[other] if other in dialled else None) for other in others)


def new_run_name() -> str:
    """A name that no other run has: the prefix of all its keys."""
    return f"coheft-{secrets.token_hex(4)}"


def _seen_from(folder: Path, config: ServerConfig | AgentProcessConfig) -> ServerConfig | AgentProcessConfig:
    """The configuration with its files' paths as seen from ``folder``, which may come to lie on another host."""
    if config.security is None:
        return config
    paths = msgspec.to_builtins(config.security)
    relative = Credentials(**{name: os.path.relpath(path, folder.resolve()) for name, path in paths.items()})
    return msgspec.structs.replace(config, security=relative)

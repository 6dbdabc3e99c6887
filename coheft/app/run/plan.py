"""The plan of a run: the configurations of all processes, determined before the first one starts."""

import os
import secrets
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from coheft.app.run.folder import RUN_FILE, RunFile
from coheft.app.run.hosts import LOOPBACK, Hosts, free_ports, places_on
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
    """Configurations of all processes of a run, planned at ``began`` [s since 1970].

    ``keys`` is the folder with all participants' credentials; None for the open profile.
    """

    server: ServerConfig
    agents: dict[str, AgentProcessConfig]
    keys: Path | None = None
    began: float = field(default_factory=time.time)

    def run_file(self, pids: dict[str, int] | None = None) -> RunFile:
        """Return the addresses of the run, and the ids of its processes that have been started, by name."""
        agents = {name: agent.observe for name, agent in self.agents.items()}
        keys = str(self.keys.resolve()) if self.keys is not None else None
        server = self.server
        return RunFile(server.run, server.observe, agents, pids or {}, keys, self.began)

    def write(self, folder: Path) -> list[Path]:
        """Write each configuration to a file of its own, so that the parts can be started by hand; return the paths.

        The folder also gets the file with which commands such as ``coheft watch --run FOLDER`` find the run. Paths of
        keys are relative to the folder.
        """
        folder.mkdir(parents=True, exist_ok=True)
        keys = os.path.relpath(self.keys.resolve(), folder.resolve()) if self.keys is not None else None
        (folder / RUN_FILE).write_bytes(msgspec.json.encode(msgspec.structs.replace(self.run_file(), keys=keys)))
        paths = []
        configs: dict[str, ServerConfig | AgentProcessConfig] = {SERVER: self.server, **self.agents}
        for name, config in configs.items():
            paths.append(folder / f"{name}.json")
            paths[-1].write_bytes(msgspec.json.format(msgspec.json.encode(_relative_to(folder, config))) + b"\n")
        return paths


def check_no_parts(folder: Path, scenario: Scenario) -> None:
    """Raise a ``CoheftError`` if a configuration would be overwritten: parts of two runs would not find each other."""
    for name in (RUN_FILE, *(f"{part}.json" for part in (SERVER, *scenario.robot_names))):
        if (folder / name).exists():
            raise CoheftError(
                f"{folder / name} exists already: configurations are never overwritten; name another folder"
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
    """Make the plan of a run: build the graph and assign endpoints.

    Without hosts, all parts listen at free ports of this machine's loopback interface; without a folder of keys, see
    ``coheft.app.run.keys``, links have the open profile.

    Raises:
        LinkError: There are not enough free ports.
        CoheftError: Credentials are missing, or other machines could access a run with the open profile.
    """
    names = scenario.robot_names
    graph = build_graph(scenario.graph, names)
    if keys is None and hosts is not None and hosts.are_remote:
        raise CoheftError("across hosts any process could connect and send messages: add --secure")
    listeners = [*[SERVER] * (1 + len(names)), *names, *names]
    places = (
        places_on(hosts, listeners)
        if hosts is not None
        else (f"{LOOPBACK}:{port}" for port in free_ports(len(listeners)))
    )
    endpoints = (f"{'tls' if keys is not None else 'tcp'}/{place}" for place in places)

    def credentials(name: str) -> Credentials | None:
        return credentials_in(keys, name) if keys is not None else None

    run = run or new_run_name()
    # In real time, a robot that waited longer would be late with its own reference.
    patience = {} if clock != "realtime" else {"patience": scenario.lookahead * scenario.block_duration}
    observe = next(endpoints)
    robots, listen, observe_agent = ({name: next(endpoints) for name in names} for _ in range(3))
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
                observe=observe_agent[name],
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
    """Return a robot's links to its neighbours: on each edge the robot that comes first listens, and the other one
    dials; ``listen`` are the endpoints in the order of the team.
    """
    order = list(listen)
    dialled = order[: order.index(name)]
    return tuple(Neighbour(name=other, endpoint=listen[other] if other in dialled else None) for other in others)


def new_run_name() -> str:
    """Return a unique name for a run, the prefix of all its keys."""
    return f"coheft-{secrets.token_hex(4)}"


def _relative_to(folder: Path, config: ServerConfig | AgentProcessConfig) -> ServerConfig | AgentProcessConfig:
    """Return the configuration with file paths relative to ``folder``, which may be copied to another host."""
    if config.security is None:
        return config
    paths = msgspec.to_builtins(config.security)
    relative = Credentials(**{name: os.path.relpath(path, folder.resolve()) for name, path in paths.items()})
    return msgspec.structs.replace(config, security=relative)

"""What a run is planned to be: configurations of its parts, addresses and ports, and the runs that can be found."""

from __future__ import annotations

import contextlib
import json
import os
import socket
from pathlib import Path

import msgspec
import pytest

from coheft.app.cli.base import EXIT_CONVERGED, EXIT_ERROR
from coheft.app.cli.main import run_command_line
from coheft.app.run.folder import RUN_FILE, RunFile, announced, find_run, runs_folder
from coheft.app.run.hosts import free_ports
from coheft.app.run.plan import make_plan
from coheft.errors import CoheftError
from coheft.wire.config import AgentProcessConfig, ServerConfig
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import Scenario

pytestmark = pytest.mark.usefixtures("own_state_folder")


@pytest.fixture
def ring6() -> Scenario:
    return load_scenario("ring6")


def test_written_configs_are_what_the_processes_read(tmp_path: Path) -> None:
    assert run_command_line(["run", "ring6", "--write-configs", str(tmp_path)]) == EXIT_CONVERGED
    server = msgspec.json.decode((tmp_path / "server.json").read_bytes(), type=ServerConfig)
    assert server.scenario == load_scenario("ring6")
    for name in server.robots:
        agent = msgspec.json.decode((tmp_path / f"{name}.json").read_bytes(), type=AgentProcessConfig)
        assert agent.agent.name == name
        assert agent.server == server.robots[name]


@pytest.mark.parametrize("more", [(), ("--secure",)])
def test_configs_of_another_run_are_not_overwritten(
    more: tuple[str, ...], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(["run", "ring6", "--write-configs", str(tmp_path)]) == EXIT_CONVERGED
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    assert run_command_line(["run", "ring3", "--write-configs", str(tmp_path), *more]) == EXIT_ERROR
    complaint = "run.json exists already: configurations are never overwritten; name another folder"
    assert complaint in " ".join(capfd.readouterr().err.split())
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    ("command", "part", "complaint"),
    [
        ("agent", "server", "server.json is a server's configuration: start it with 'coheft server'"),
        ("server", "r1", "r1.json is an agent's configuration: start it with 'coheft agent'"),
        ("agent", "run", "run.json is not a configuration; it tells other commands the run's addresses"),
        ("server", "run", "run.json is not a configuration; it tells other commands the run's addresses"),
    ],
)
def test_a_part_that_is_started_with_the_file_of_another_one_is_told_so(
    command: str, part: str, complaint: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(["run", "ring3", "--write-configs", str(tmp_path)]) == EXIT_CONVERGED
    assert run_command_line([command, str(tmp_path / f"{part}.json")]) == EXIT_ERROR
    assert complaint in " ".join(capfd.readouterr().err.split())


def test_an_agents_config_tells_nothing_about_the_team(ring6: Scenario) -> None:
    """Neither the payload, nor who else is there, nor how many."""
    plan = make_plan(ring6)
    for name, config in plan.agents.items():
        text = msgspec.json.encode(config).decode()
        assert not {"payload", "boxes", "grasps", "perimeter", "graph", "load_changes"} & set(_keys(json.loads(text)))
        strangers = set(plan.agents) - {name} - set(config.agent.neighbours)
        assert len(strangers) == 3
        assert not [other for other in strangers if f'"{other}"' in text]


def _keys(value: object) -> list[str]:
    if isinstance(value, dict):
        return [*value, *(key for inner in value.values() for key in _keys(inner))]
    return [key for inner in value for key in _keys(inner)] if isinstance(value, list) else []


def test_along_every_edge_exactly_one_dials_where_the_other_listens(ring6: Scenario) -> None:
    plan = make_plan(ring6)
    for name, config in plan.agents.items():
        for neighbour in config.neighbours:
            back = next(n for n in plan.agents[neighbour.name].neighbours if n.name == name)
            assert (neighbour.endpoint is None) != (back.endpoint is None)
            assert neighbour.endpoint in (None, plan.agents[neighbour.name].listen)


def test_every_plan_has_a_prefix_and_ports_of_its_own(ring6: Scenario) -> None:
    plan = make_plan(ring6)
    endpoints = [plan.server.observe, *plan.server.robots.values()]
    endpoints += [endpoint for agent in plan.agents.values() for endpoint in (agent.listen, agent.observe)]
    assert len(set(endpoints)) == 3 * 6 + 1
    assert plan.server.run != make_plan(ring6).server.run


def test_free_ports_can_be_listened_on() -> None:
    for port in free_ports(10):
        assert 1024 <= port < 32768
        with socket.socket() as listener:
            listener.bind(("127.0.0.1", port))


def test_many_ports_take_no_more_files_than_one() -> None:
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (256, limits[1]))
    try:
        assert len(set(free_ports(1000))) == 1000
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)


def test_the_newest_run_that_answers_is_found() -> None:
    with contextlib.ExitStack() as stack:
        listeners = [stack.enter_context(socket.socket()) for _ in range(2)]
        for number, listener in enumerate(listeners):
            port = free_ports(1)[0]
            listener.bind(("127.0.0.1", port))
            listener.listen()
            folder = runs_folder() / f"run{number}"
            folder.mkdir(parents=True)
            entry = RunFile(run=f"run{number}", server=f"tcp/127.0.0.1:{port}", agents={}, began=float(number))
            stack.enter_context(announced(folder, entry))
            os.utime(folder / RUN_FILE, (-number, -number))  # it is written anew whenever an agent starts again
        assert find_run().run == "run1"
        listeners[1].close()  # as if killed: its file stays behind
        assert find_run().run == "run0"
        with pytest.raises(CoheftError, match="no run is in progress"):
            find_run(runs_folder() / "run1")


def test_a_run_that_ended_is_not_found() -> None:
    folder = runs_folder() / "over"
    folder.mkdir(parents=True)
    with announced(folder, RunFile(run="over", server="tcp/127.0.0.1:1", agents={})):
        pass
    assert list(folder.iterdir()) == []

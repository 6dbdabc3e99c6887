"""A team of real processes for tests: a server, agents, and an observer in the test's own process."""

from __future__ import annotations

import atexit
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import IO, Literal

import msgspec
import zenoh

from coheft.app.run.fork_server import Forked, ForkServer, can_fork
from coheft.app.run.plan import Plan, make_plan
from coheft.app.run.processes import ENVIRONMENT, FORKED
from coheft.errors import LinkError
from coheft.wire.messages.requests import Refusal, Request, Status, StatusRequest
from coheft.wire.scenario.file import parse_scenario
from coheft.wire.scenario.schema import Scenario
from coheft.wire.transport.planes import guard_observer
from coheft.wire.transport.security import credentials_in
from coheft.wire.transport.sessions import Keys, ask, open_session
from tests.waiting import LIMIT, wait_until

ROOT = Path(__file__).parents[2]
AGENT = ("-m", "coheft.agents.process.main")
SERVER = ("-m", "coheft.physics_server.server")


def small_scenario(count: int, kind: str = "ring", duration: float = 1e4, block: int = 10) -> Scenario:
    """A few robots around a box; without a set duration it runs until it is told to stop."""
    text = f"""
        name = "small"
        duration = {duration}
        payload = {{ boxes = [{{ mass = 8.0, size = [0.8, 0.6, 0.1] }}], load_slots = 2 }}
        robots = {{ perimeter = {{ count = {count}, extent = [0.8, 0.6] }} }}
        graph = {{ kind = "{kind}" }}
        sensors = {{ block = {block} }}
    """
    return parse_scenario(text, "small_scenario")


@cache
def fork_server() -> ForkServer:
    """One for all teams of all tests, which ends with the tests."""
    made = ForkServer(FORKED, {**os.environ, **ENVIRONMENT, "PYTHONPATH": str(ROOT)})
    atexit.register(made.close)
    return made


@dataclass
class Team:
    """Running processes of a plan, by name (``server`` is one of them), and a link to the server."""

    plan: Plan
    keys: Keys
    folder: Path
    observer: zenoh.Session
    processes: dict[str, subprocess.Popen[bytes] | Forked]

    def start(self, name: str, command: tuple[str, ...], config: msgspec.Struct) -> None:
        """Start one more process, or one again; what it prints is added to ``<name>.log``."""
        if name in self.processes:
            self.end(name)
        with (self.folder / f"{name}.log").open("ab") as log:
            self.processes[name] = self._forked(name, command, log) or subprocess.Popen(
                [sys.executable, *command],
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                cwd=ROOT,
                env={**os.environ, **ENVIRONMENT, "PYTHONPATH": str(ROOT), "HEARD_FOLDER": str(self.folder)},
            )
        stdin = self.processes[name].stdin
        assert stdin is not None
        stdin.write(msgspec.json.encode(config) + b"\n")
        stdin.flush()

    def _forked(self, name: str, command: tuple[str, ...], log: IO[bytes]) -> Forked | None:
        """Start one of coheft's own processes without loading its modules anew, where systems can."""
        if command not in (AGENT, SERVER) or not can_fork():
            return None
        return fork_server().start(name, command[1], log.fileno())

    def restart(self, name: str) -> None:
        """Start the server or an agent again, with the configuration that it had."""
        if name == "server":
            self.start(name, SERVER, self.plan.server)
        else:
            self.start(name, AGENT, self.plan.agents[name])

    def kill(self, name: str) -> None:
        """Kill a process, and wait until it is gone."""
        self.processes[name].kill()
        self.processes[name].wait()

    def end(self, name: str) -> None:
        """Kill a process and let go of what it leaves."""
        self.kill(name)
        stdin = self.processes[name].stdin
        if stdin is not None:
            with suppress(BrokenPipeError):
                stdin.close()

    def ask(self, request: Request) -> Status:
        """The server's answer to a request that it can carry out."""
        answer = ask(Status, self.observer, self.keys.request("operator"), request)
        assert isinstance(answer, Status), answer
        return answer

    def refusal(self, request: Request) -> str:
        """Why the server does not carry a request out."""
        answer = ask(Status, self.observer, self.keys.request("operator"), request)
        assert isinstance(answer, Refusal), answer
        return answer.reason

    def status(self) -> Status | None:
        """How the run is; None while the server does not answer."""
        try:
            return self.ask(StatusRequest())
        except LinkError:
            return None

    def wait_for_block(self, block: int) -> None:
        """Wait until so many blocks have been simulated."""

        def is_there() -> bool:
            for name, process in self.processes.items():
                assert process.poll() in (None, 0), f"{name}: {self.log(name)}"
            status = self.status()
            return status is not None and status.block >= block

        wait_until(is_there, f"block {block}")

    def log(self, name: str) -> str:
        """What a process has printed so far."""
        return (self.folder / f"{name}.log").read_text()

    def refusals(self, name: str) -> list[str]:
        """What a process has refused so far."""
        return [line for line in self.log(name).splitlines() if "refused" in line]

    def exit_status(self, name: str) -> int:
        """Of a process that is about to end."""
        return self.processes[name].wait(LIMIT)


@contextmanager
def running_team(
    scenario: Scenario,
    folder: Path,
    clock: Literal["lockstep", "realtime"] = "lockstep",
    agent_command: tuple[str, ...] = AGENT,
    keys_folder: Path | None = None,
    change: Callable[[Plan], Plan] = lambda plan: plan,
    server_command: tuple[str, ...] = SERVER,
) -> Iterator[Team]:
    """Start a team, secure if there is a folder of keys; whatever happens, no process is left at the end.

    The plan may be changed before.
    """
    plan = change(make_plan(scenario, clock, keys=keys_folder))
    keys = Keys(plan.server.run)
    credentials = credentials_in(keys_folder, "operator") if keys_folder is not None else None
    guard = guard_observer(credentials, keys, "operator", [])
    with open_session(connect=[plan.server.observe], guard=guard) as observer:
        team = Team(plan, keys, folder, observer, {})
        try:
            team.start("server", server_command, plan.server)
            for name, config in plan.agents.items():
                team.start(name, agent_command, config)
            yield team
        except BaseException:
            for name in team.processes:
                print(f"{name} has said:\n{team.log(name)}")  # pytest shows it if the test fails
            raise
        finally:
            for name in team.processes:
                team.end(name)

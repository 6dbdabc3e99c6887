"""Teams of real processes that can be paused, so that several of them can take turns."""

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import psutil
import zenoh
from msgspec.structs import replace

from benchmarks.replay import SETTING
from coheft.app.run.plan import Plan, make_plan
from coheft.app.run.processes import Processes
from coheft.errors import LinkError
from coheft.wire.messages.requests import PauseRequest, Refusal, Request, RunState, Status, StatusRequest
from coheft.wire.scenario.schema import Scenario
from coheft.wire.transport.planes import guard_observer
from coheft.wire.transport.security import credentials_in
from coheft.wire.transport.sessions import Keys, ask, open_session

_LIMIT = 120.0
"""Longest time to wait for anything [s]."""
_ANSWER = 5.0
_POLL = 0.05
SIZES = (6, 24)
"""Numbers of robots of the teams that are compared."""
TURN = {6: 1.0, 24: 2.0}
"""Duration of a turn, by number of robots [s]."""


@dataclass(frozen=True)
class Turn:
    """Blocks of a team in a turn, its wall-clock time, and the CPU time of each process by name [s]."""

    blocks: int
    wall: float
    cpu: dict[str, float]

    @property
    def block_time(self) -> float:
        """Wall-clock time per block [s]."""
        return self.wall / self.blocks

    @property
    def team_time(self) -> float:
        """CPU time of all processes together per block [s]."""
        return sum(self.cpu.values()) / self.blocks

    @property
    def agent_time(self) -> float:
        """CPU time per agent and block [s]."""
        agents = [seconds for name, seconds in self.cpu.items() if name != "server"]
        return sum(agents) / len(agents) / self.blocks

    @property
    def server_time(self) -> float:
        """CPU time of the server per block [s]."""
        return self.cpu["server"] / self.blocks


def compared(quantity: str, *teams: Sequence[Turn]) -> list[list[float]]:
    """Return a quantity of ``Turn``, by name, in all turns of each team."""
    return [[getattr(turn, quantity) for turn in turns] for turns in teams]


class PacedTeam:
    """A team of processes in lockstep, see ``paced_team``."""

    def __init__(self, plan: Plan, processes: Processes, session: zenoh.Session) -> None:
        self._processes = processes
        self._session = session
        self._key = Keys(plan.server.run).request("operator")
        self._children = {name: psutil.Process(pid) for name, pid in processes.pids.items()}

    def run_until(self, seconds: float) -> None:
        """Run up to a simulated time [s], then pause; raise ``LinkError`` if the team does not reach it."""
        deadline = time.monotonic() + _LIMIT
        while True:
            self._processes.check()
            if time.monotonic() > deadline:
                raise LinkError(f"the team is not at {seconds:g} s after {_LIMIT:g} s; see {self._processes.folder}")
            try:
                status = self._ask(StatusRequest())
            except LinkError:  # it has not begun to listen
                time.sleep(_POLL)
                continue
            if status.state is not RunState.WAITING and status.time >= seconds:
                break
            time.sleep(_POLL)
        self._ask(PauseRequest(paused=True))

    def turn(self, seconds: float) -> Turn:
        """Run for a time [s], or until a block is done; the team is paused before and after."""
        cpu = cpu_times(self._children)
        before = self._ask(PauseRequest(paused=False))
        time.sleep(seconds)
        deadline = time.monotonic() + _LIMIT
        while self._ask(StatusRequest()).block == before.block:  # the machine has stood still
            if time.monotonic() > deadline:
                raise LinkError(f"the team has not gone on for {_LIMIT:g} s; see {self._processes.folder}")
            time.sleep(_POLL)
        after = self._ask(PauseRequest(paused=True))
        time.sleep(_POLL)  # for the last answers
        return Turn(
            blocks=after.block - before.block,
            wall=_ran(after) - _ran(before),
            cpu={name: now - cpu[name] for name, now in cpu_times(self._children).items()},
        )

    def _ask(self, request: Request) -> Status:
        answer = ask(Status, self._session, self._key, request, timeout=_ANSWER)
        if isinstance(answer, Refusal):
            raise LinkError(f"the server refuses: {answer.reason}")
        return answer


def cpu_times(processes: Mapping[str, psutil.Process]) -> dict[str, float]:
    """Return the CPU time of each process so far, by name [s]."""
    times = {name: process.cpu_times() for name, process in processes.items()}
    return {name: each.user + each.system for name, each in times.items()}


def _ran(status: Status) -> float:
    """Return the wall-clock time of the run without pauses [s]."""
    return status.time / status.real_time_factor if status.real_time_factor > 0.0 else 0.0


@contextmanager
def paced_team(
    scenario: Scenario, folder: Path, replay: Mapping[str, Path] | None = None, keys: Path | None = None
) -> Iterator[PacedTeam]:
    """Start a team, with its logs in a new folder.

    ``replay`` are files of each agent's messages for a team without mathematics and physics, see ``benchmarks.replay``;
    ``keys`` is the folder of certificates for the secure profile.
    """
    folder.mkdir()
    plan = make_plan(scenario, keys=keys)
    operator = None if keys is None else credentials_in(keys, "operator")
    guard = guard_observer(operator, Keys(plan.server.run), "operator", [])
    with Processes(folder) as processes, open_session(connect=[plan.server.observe], guard=guard) as session:
        server, agent = "coheft.physics_server.server", "coheft.agents.process.main"
        configs = plan.agents
        if replay is not None:
            server, agent = "benchmarks.bare_server", "benchmarks.bare_agent"
            configs = {
                name: replace(config, agent=replace(config.agent, estimator_settings={SETTING: str(replay[name])}))
                for name, config in plan.agents.items()
            }
        processes.start("server", server, plan.server)
        for name, config in configs.items():
            processes.start(name, agent, config)
        yield PacedTeam(plan, processes, session)

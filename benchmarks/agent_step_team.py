"""One team of agents in a process of its own, which ``benchmarks.agent_step`` times or whose calls it counts.

This script runs with any checkout of coheft in ``PYTHONPATH``, also an older one:

    PYTHONPATH=ROOT python -P benchmarks/agent_step_team.py ROBOTS ESTIMATOR ROOT [--count]

So it uses only those parts of coheft that an agent's process needs, with that checkout's scenarios and settings. An
empty line on stdout says that the team is ready; then each line of stdin is a ``Turn``, which is answered by a ``Took``
on stdout.
"""

import argparse
import cProfile
import math
import signal
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import CodeType

import msgspec
import numpy as np
from msgspec.structs import replace

import coheft.agents.agent
from benchmarks.scenarios import team_scenario
from coheft.agents.agent import ESTIMATORS, Agent
from coheft.agents.estimator import Belief, Channels
from coheft.consensus.gossip import Gossip
from coheft.consensus.graph import build_graph
from coheft.errors import CoheftError
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import MeasurementBlock
from coheft.wire.config import AgentConfig, agent_config
from coheft.wire.messages.codec import decode, encode
from coheft.wire.messages.structs import Estimate, Measurements, NeighbourMessage
from coheft.wire.scenario.schema import Scenario

NONE = "none"
"""Name of the estimator that does no mathematics."""
LARGEST_SHIPPED = 24
"""Number of robots of the largest shipped ring."""
COUNTED = 6
"""Largest number of agents whose calls are counted, spread evenly over the team."""
_OWN_CALL = "<method 'disable' of '_lsprof.Profiler' objects>"
"""The call that the count itself makes."""


class Turn(msgspec.Struct, frozen=True):
    """Consecutive blocks, and the NumPy file with all robots' samples, shape (blocks, robots, B, 15)."""

    path: str
    first: int


class Took(msgspec.Struct, frozen=True):
    """Costs of a turn.

    Attributes:
        seconds: CPU time of all agents together, per block [s].
        worst: The longest step of one agent [s].
        sizes: Size of all messages to neighbours [B].
        knows_poses: Whether all agents know their poses, per block.
        calls: Number of calls of Python functions, of the counted agents.
        c_calls: Number of calls of C functions.
    """

    seconds: list[float]
    worst: float
    sizes: int
    knows_poses: list[bool]
    calls: int
    c_calls: int


class NoMathematics:
    """An estimator that does nothing, to measure the rest of the agent."""

    def __init__(self, config: AgentConfig, gossip: Gossip) -> None:
        """Ignore both."""

    def step(self, index: int, own: MeasurementBlock | None, inbox: Mapping[str, Channels]) -> dict[str, Array]:
        """Send nothing."""
        return {}

    def fits(self, channels: Channels) -> bool:
        """Accept all messages."""
        return True

    def belief(self) -> Belief:
        """Return an empty belief."""
        return Belief("poses", False, None, {})

    def doubts(self) -> tuple[str, ...]:
        """Return none."""
        return ()


def ring(robots: int) -> Scenario:
    """Return a ring without load changes, with sensors at 1 kHz and 20 samples a block.

    Up to 24 robots hold the payload of a shipped ring. More robots hold that of ``ring24``, with mass and area scaled
    so that each robot's share is the same; each moves more, because the motions of many average out.
    """
    scenario = team_scenario(robots)
    share = robots / LARGEST_SHIPPED
    if share <= 1.0:
        return scenario
    wider = math.sqrt(share)
    boxes = tuple(
        replace(
            box,
            mass=share * box.mass,
            size=(wider * box.size[0], wider * box.size[1], box.size[2]),
            position=(wider * box.position[0], wider * box.position[1], box.position[2]),
        )
        for box in scenario.payload.boxes
    )
    rim = scenario.robots.perimeter
    assert rim is not None
    rim = replace(rim, extent=(wider * rim.extent[0], wider * rim.extent[1]))
    return replace(
        scenario,
        payload=replace(scenario.payload, boxes=boxes),
        robots=replace(scenario.robots, perimeter=rim),
        motion=replace(scenario.motion, translation=wider * scenario.motion.translation),
    )


class WholeTeam:
    """All agents of a team, with the encoding and decoding of their processes. Counting calls makes times longer."""

    def __init__(self, scenario: Scenario, is_counting: bool) -> None:
        self._graph = build_graph(scenario.graph, scenario.robot_names)
        self._agents = {name: Agent(agent_config(scenario, name, others)) for name, others in self._graph.items()}
        self._keys = {name: f"coheft/agent-step/{name}/block" for name in self._graph}  # as long as those of a run
        self._sent: dict[str, bytes] = {}
        self._knows_poses: set[str] = set()
        self._profile = cProfile.Profile()
        names = list(self._graph)
        counted = min(COUNTED, len(names)) if is_counting else 0
        self._counted = {names[k * len(names) // counted] for k in range(counted)}

    def take(self, turn: Turn) -> Took:
        """Run a turn, and return its costs."""
        seconds, knows_poses, worst, sizes = [], [], 0.0, 0
        for block, samples in enumerate(np.load(turn.path), turn.first):
            times = self._step(block, samples)
            seconds.append(sum(times))
            worst = max(worst, *times)
            sizes += sum(map(len, self._sent.values()))
            knows_poses.append(len(self._knows_poses) == len(self._agents))
        calls, c_calls = self._calls()
        return Took(seconds, worst, sizes, knows_poses, calls, c_calls)

    def _step(self, block: int, samples: Array) -> list[float]:
        """Run one block; return the CPU time of each agent [s]."""
        measured = [
            encode(Measurements(robot=name, block=block, samples=each), self._keys[name])
            for name, each in zip(self._agents, samples, strict=True)
        ]
        sent: dict[str, bytes] = {}
        times = []
        for name, mine in zip(self._agents, measured, strict=True):
            if is_counted := name in self._counted:
                self._profile.enable()
            began = time.process_time()
            sent[name], estimate = self._answer(name, mine)
            times.append(time.process_time() - began)
            if is_counted:
                self._profile.disable()
            if estimate is not None and estimate.phase != "poses":
                self._knows_poses.add(name)
        self._sent = sent
        return times

    def _answer(self, name: str, measured: bytes) -> tuple[bytes, Estimate | None]:
        """Decode, step and encode; return an agent's message, and its report if one is due."""
        keys, sent = self._keys, self._sent
        own = decode(measured, Measurements, keys[name])
        others = [other for other in self._graph[name] if other in sent]
        messages = [decode(sent[other], NeighbourMessage, keys[other]) for other in others]
        outbox = self._agents[name].step(own.block, MeasurementBlock(own.block, own.samples), messages)
        encode(outbox.reference, keys[name])
        if outbox.estimate is not None:
            encode(outbox.estimate, keys[name])
        return encode(outbox.message, keys[name]), outbox.estimate

    def _calls(self) -> tuple[int, int]:
        """Return the numbers of calls of Python and of C functions since the last time."""
        calls = c_calls = 0
        for entry in self._profile.getstats():
            if isinstance(entry.code, CodeType):
                calls += entry.callcount
            elif entry.code != _OWN_CALL:
                c_calls += entry.callcount
        self._profile.clear()
        return calls, c_calls


def main() -> None:
    """Answer until stdin ends."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robots", type=int)
    parser.add_argument("estimator")
    parser.add_argument("root", type=Path, help="the checkout to measure")
    parser.add_argument("--count", action="store_true")
    chosen = parser.parse_args()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent receives it too, and closes stdin
    found = Path(coheft.agents.agent.__file__).resolve()
    if not found.is_relative_to(chosen.root.resolve()):
        sys.exit(f"meant to measure the agents of {chosen.root}, but found those of {found.parents[1]}")
    ESTIMATORS[NONE] = NoMathematics
    with suppress(ImportError):  # older checkouts do without
        from coheft.wire.process.memory import reuse_memory

        reuse_memory()
    try:
        team = WholeTeam(replace(ring(chosen.robots), estimator=chosen.estimator), chosen.count)
        print(flush=True)
        for line in sys.stdin.buffer:
            took = team.take(msgspec.json.decode(line, type=Turn))
            print(msgspec.json.encode(took).decode(), flush=True)
    except CoheftError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()

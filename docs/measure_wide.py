"""Measure what docs/wide.md tells of large teams: ``python docs/measure_wide.py sums|gossip|agents``.

No physics: what robots measure comes from the formulas of a rigid body, with noise. Times are processor times.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from typing import Literal

import msgspec
import numpy as np

from coheft.agents.agent import Agent
from coheft.consensus.gossip import Gossip
from coheft.consensus.graph import Neighbours, build_graph
from coheft.consensus.rounds import make_rounds
from coheft.consensus.schedule import choose_schedule
from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp
from coheft.estimation.measurement import MeasurementBlock, SensorNoise
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.wire.config import agent_config
from coheft.wire.messages.codec import encode
from coheft.wire.messages.structs import NeighbourMessage
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import Graph, Perimeter, Robots, Scenario

BLOCK = 10
CHANNELS = 18
"""Numbers that are summed per sample."""
Kind = Literal["ring", "grid", "tree"]
KINDS: tuple[Kind, ...] = ("ring", "grid", "tree")


def network(kind: Kind, count: int) -> Neighbours:
    """Robots in a graph."""
    return build_graph(Graph(kind=kind), [f"r{k:05d}" for k in range(count)])


def timed(work: Callable[[], object]) -> float:
    """Processor time [s]."""
    start = time.process_time()
    work()
    return time.process_time() - start


def size(channels: dict[str, Array]) -> int:
    """Of a message [B]."""
    return len(encode(NeighbourMessage(sender="r00000", block=1, gossip=[], channels=channels), "key"))


def sums() -> None:
    """Rounds, bytes and time of the exact sums alone."""
    print("graph robots schedule rounds set-up[ms] message[B] time per agent and block[us]")
    values = np.random.default_rng(0).normal(size=(BLOCK, CHANNELS))
    for kind in KINDS:
        for count in (24, 100, 300, 1000, 3000, 10000):
            if kind == "ring" and count > 1000:
                continue
            graph = network(kind, count)
            schedule = choose_schedule(graph)
            set_up = timed(lambda graph=graph: choose_schedule(graph))  # type: ignore[misc]
            agents = {
                name: make_rounds(schedule, "sums", name, others, BLOCK, CHANNELS) for name, others in graph.items()
            }
            told: dict[str, dict[str, Array]] = {name: {} for name in graph}
            passed, totals = [], []
            for _ in range(schedule.rounds + 5):
                before = dict(told)
                start = time.process_time()
                for name, agent in agents.items():
                    totals.append(agent.advance({other: before[other] for other in graph[name]}))
                    agent.enter(values)
                    told[name] = agent.channels()
                passed.append((time.process_time() - start) / count)
                totals = totals[-1:]
            assert totals[0] is not None
            np.testing.assert_allclose(schedule.scale * totals[0], count * values, rtol=1e-8)
            largest = max(size(channels) for channels in told.values())
            print(
                f"{kind:5} {count:6} {schedule.kind:11} {schedule.rounds:5} {1e3 * set_up:8.1f} {largest:8}"
                f" {1e6 * float(np.median(passed[-5:])):8.0f}",
                flush=True,
            )


def gossip() -> None:
    """What it takes until every robot knows the graph, from the first message on."""
    print("graph robots blocks bytes-per-edge[B] largest-message[B] time-per-agent[ms]")
    for kind in KINDS:
        for count in (24, 100, 300, 1000):
            graph = network(kind, count)
            robots = {name: Gossip(name, others) for name, others in graph.items()}
            watched = next(iter(graph))
            blocks = carried = largest = 0
            start = time.process_time()
            while any(robot.graph is None for robot in robots.values()):
                told = {name: robot.news() for name, robot in robots.items()}
                message = NeighbourMessage(sender=watched, block=1, gossip=told[watched], channels={})
                carried += len(encode(message, "key"))
                largest = max(largest, len(encode(message, "key")))
                for name, others in graph.items():
                    for other in others:
                        robots[name].hear(told[other])
                blocks += 1
            passed = (time.process_time() - start) / count
            print(f"{kind:5} {count:6} {blocks:6} {carried:9} {largest:7} {1e3 * passed:8.1f}", flush=True)


class Feed:
    """What robots measure that hold one load.

    Args:
        count: Of the robots.
        noise: Of their sensors.
        rate: Samples per second.
    """

    def __init__(self, count: int, noise: SensorNoise, rate: int) -> None:
        rng = self._rng = np.random.default_rng(0)
        self._rate, self._noise = rate, noise.per_column()
        self._places = rng.uniform([-1.0, -0.7, -0.1], [1.0, 0.7, 0.1], size=(count, 3))
        poses = [Pose(rotation_exp(rng.normal(size=3)), place) for place in self._places]
        self._rotations = np.array([pose.rotation for pose in poses])
        self.load = Inertia(1.6 * count, np.array([0.1, -0.05, 0.02]), 1.6 * count * np.diag([0.16, 0.33, 0.49]))
        self._pulsations = 2.0 * np.pi * rng.uniform(0.4, 1.6, size=(6, 2, 1))
        self._phases = rng.uniform(0.0, 2.0 * np.pi, size=(6, 2, 1))

    def samples(self, block: int) -> Array:
        """Of all robots in a block, shape (N, B, 15)."""
        times = (block * BLOCK + np.arange(BLOCK)) / self._rate
        angles = self._pulsations * times + self._phases
        amplitudes = np.repeat([0.5, 0.15], 3)[:, None, None]
        motion = (amplitudes * np.sin(angles)).sum(axis=1).T
        slopes = (amplitudes * self._pulsations * np.cos(angles)).sum(axis=1).T
        w, v, alpha = motion[:, :3], motion[:, 3:], slopes[:, :3]
        down = np.column_stack([0.1 * np.sin(1.1 * times), 0.1 * np.cos(0.7 * times), -np.ones(BLOCK)])
        a = slopes[:, 3:] + np.cross(w, v) - 9.81 * down / np.linalg.norm(down, axis=1)[:, None]
        places, load = self._places[:, None], self.load
        force = load.mass * (a + np.cross(alpha, load.com) + np.cross(w, np.cross(w, load.com)))
        torque = alpha @ load.tensor + np.cross(w, w @ load.tensor) + np.cross(load.com, force)
        columns = np.array(
            [
                np.broadcast_to(w, (len(places), BLOCK, 3)),
                v + np.cross(w, places),
                a + np.cross(alpha, places) + np.cross(w, np.cross(w, places)),
                np.broadcast_to(force / len(places), (len(places), BLOCK, 3)),
                torque / len(places) - np.cross(places, force / len(places)),
            ]
        )
        seen = np.einsum("cnbi,nij->nbcj", columns, self._rotations).reshape(len(places), BLOCK, 15)
        result: Array = seen + self._noise * self._rng.normal(size=seen.shape)
        return result


def large_team(kind: Kind, count: int) -> Scenario:
    """A scenario of which only the agents' part is used."""
    base = load_scenario("grid48")
    robots = Robots(perimeter=Perimeter(count=count, extent=(2.0, 1.4)))
    return msgspec.structs.replace(base, robots=robots, graph=Graph(kind=kind))


def run_agents(kind: Kind, count: int, blocks: int, every: int = 10) -> None:
    """A whole team in this process, sums and all."""
    scenario = large_team(kind, count)
    graph = build_graph(scenario.graph, scenario.robot_names)
    agents = {name: Agent(agent_config(scenario, name, others)) for name, others in graph.items()}
    feed = Feed(count, scenario.noise, scenario.sensors.rate)
    told: Mapping[str, NeighbourMessage] = {}
    masses: dict[str, float] = {}
    phase, passed, sizes = "", [], []
    for block in range(blocks):
        measured = feed.samples(block)
        start = time.process_time()
        outboxes = {
            name: agent.step(
                block, MeasurementBlock(block, measured[k]), [told[other] for other in graph[name] if other in told]
            )
            for k, (name, agent) in enumerate(agents.items())
        }
        passed.append((time.process_time() - start) / count)
        told = {name: outbox.message for name, outbox in outboxes.items()}
        sizes.append(max(len(encode(told[name], "key")) for name in list(told)[:: max(1, count // 20)]))
        for name, outbox in outboxes.items():
            if outbox.estimate is not None:
                phase = outbox.estimate.phase
                if outbox.estimate.payload is not None:
                    masses[name] = outbox.estimate.payload.mass
        if block % every == every - 1:
            off = [abs(mass / feed.load.mass - 1.0) for mass in masses.values()]
            print(
                f"{kind} {count} block {block + 1:5} {phase:8} per agent and block: median "
                f"{1e6 * np.median(passed):6.0f} us, mean {1e6 * np.mean(passed):6.0f} us; largest message "
                f"{max(sizes):6} B; {len(masses)} know the load"
                f"{f', mass off by at most {max(off):.2%}' if off else ''}; channels "
                f"{' '.join(sorted(outboxes[next(iter(graph))].message.channels))}",
                flush=True,
            )
            passed, sizes = [], []


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["sums"]:
            sums()
        case ["gossip"]:
            gossip()
        case ["agents", ("ring" | "grid" | "tree") as kind, count, blocks]:
            run_agents(kind, int(count), int(blocks))
        case _:
            sys.exit("sums, gossip, or agents ring|grid|tree COUNT BLOCKS expected")

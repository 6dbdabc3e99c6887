"""What docs/wide.md tells of large teams: ``python -m benchmarks.networks sums|gossip|agents``. Times are CPU times."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Literal

import numpy as np
from msgspec.structs import replace

from benchmarks.scenarios import team_scenario, weaker
from benchmarks.stepped_team import SteppedTeam
from coheft.consensus.gossip import Gossip
from coheft.consensus.graph import Neighbours, build_graph
from coheft.consensus.rounds import make_rounds
from coheft.consensus.schedule import choose_schedule
from coheft.estimation.geometry.spatial import Array
from coheft.wire.messages.codec import encode
from coheft.wire.messages.structs import NeighbourMessage
from coheft.wire.scenario.schema import Graph

BLOCK = 10
CHANNELS = 18
"""Numbers that are summed per sample."""
Kind = Literal["ring", "grid", "tree"]
KINDS: tuple[Kind, ...] = ("ring", "grid", "tree")


def network(kind: Kind, count: int) -> Neighbours:
    """Robots in a graph."""
    return build_graph(Graph(kind=kind), [f"r{k:05d}" for k in range(count)])


def timed(work: Callable[[], object]) -> float:
    """CPU time [s]."""
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


def agents(kind: Kind, count: int, blocks: int, every: int = 10) -> None:
    """A whole team and its physics in this process; what its agents take, and what they send."""
    team = SteppedTeam(replace(weaker(team_scenario(count)), graph=Graph(kind=kind)))
    while team.block < blocks:
        passed, largest = [], 0
        for _ in range(every):
            before = team.agents_time
            team.step()
            passed.append((team.agents_time - before) / count)
            largest = max(largest, *(len(encode(outbox.message, "key")) for outbox in team.outboxes.values()))
        print(
            f"{kind} {count} block {team.block:5} {' '.join(sorted(team.phases)):8} per agent and block: median "
            f"{1e6 * np.median(passed):6.0f} us, mean {1e6 * np.mean(passed):6.0f} us; largest message {largest:6} B",
            flush=True,
        )


def main() -> None:
    """Print what is asked for."""
    match sys.argv[1:]:
        case ["sums"]:
            sums()
        case ["gossip"]:
            gossip()
        case ["agents", ("ring" | "grid" | "tree") as kind, count, blocks]:
            agents(kind, int(count), int(blocks))
        case _:
            sys.exit("sums, gossip, or agents ring|grid|tree COUNT BLOCKS expected")


if __name__ == "__main__":
    main()

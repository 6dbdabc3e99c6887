"""Costs of exact sums and of gossip in large networks, for docs/wide.md: ``python -m benchmarks.networks sums|gossip``.

Times are CPU times.
"""

from __future__ import annotations

import sys
import time
from typing import Literal

import numpy as np

from coheft.consensus.gossip import Gossip
from coheft.consensus.graph import Neighbours, build_graph
from coheft.consensus.rounds import make_rounds
from coheft.consensus.schedule import choose_schedule
from coheft.estimation.geometry.spatial import Array
from coheft.wire.messages.codec import encode
from coheft.wire.messages.structs import LinkState, NeighbourMessage
from coheft.wire.scenario.schema import Graph

BLOCK = 10
CHANNELS = 18
"""Numbers that are summed per sample."""
KINDS: tuple[Literal["ring", "grid", "tree"], ...] = ("ring", "grid", "tree")


def network(kind: Literal["ring", "grid", "tree"], count: int) -> Neighbours:
    """Return the neighbours of each of ``count`` robots."""
    return build_graph(Graph(kind=kind), [f"r{k:05d}" for k in range(count)])


def size(gossip: list[LinkState], channels: dict[str, Array]) -> int:
    """Return the size of an encoded message [B]."""
    return len(encode(NeighbourMessage(sender="r00000", block=1, gossip=gossip, channels=channels), "key"))


def sums() -> None:
    """Print rounds, bytes and time of the exact sums."""
    print("graph robots schedule rounds set-up[ms] message[B] time per agent and block[us]")
    values = np.random.default_rng(0).normal(size=(BLOCK, CHANNELS))
    for kind in KINDS:
        for count in (24, 100, 300, 1000, 3000, 10000):
            if kind == "ring" and count > 1000:
                continue
            graph = network(kind, count)
            start = time.process_time()
            schedule = choose_schedule(graph)
            set_up = time.process_time() - start
            agents = {
                name: make_rounds(schedule, "sums", name, others, BLOCK, CHANNELS) for name, others in graph.items()
            }
            sent: dict[str, dict[str, Array]] = {name: {} for name in graph}
            times = []
            total: Array | None = None
            for _ in range(schedule.rounds + 5):
                before = dict(sent)
                start = time.process_time()
                for name, agent in agents.items():
                    total = agent.advance({other: before[other] for other in graph[name]})
                    agent.enter(values)
                    sent[name] = agent.channels()
                times.append((time.process_time() - start) / count)
            assert total is not None
            np.testing.assert_allclose(schedule.scale * total, count * values, rtol=1e-8)
            largest = max(size([], channels) for channels in sent.values())
            print(
                f"{kind:5} {count:6} {schedule.kind:11} {schedule.rounds:5} {1e3 * set_up:8.1f} {largest:8}"
                f" {1e6 * float(np.median(times[-5:])):8.0f}",
                flush=True,
            )


def gossip() -> None:
    """Print the costs from the first message until every robot knows the graph."""
    print("graph robots blocks bytes-per-edge[B] largest-message[B] time-per-agent[ms]")
    for kind in KINDS:
        for count in (24, 100, 300, 1000):
            graph = network(kind, count)
            robots = {name: Gossip(name, others) for name, others in graph.items()}
            observed = next(iter(graph))
            sizes = []
            start = time.process_time()
            while any(robot.graph is None for robot in robots.values()):
                sent = {name: robot.news() for name, robot in robots.items()}
                sizes.append(size(sent[observed], {}))
                for name, others in graph.items():
                    for other in others:
                        robots[name].hear(sent[other])
            taken = (time.process_time() - start) / count
            print(f"{kind:5} {count:6} {len(sizes):6} {sum(sizes):9} {max(sizes):7} {1e3 * taken:8.1f}", flush=True)


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["sums"]:
            sums()
        case ["gossip"]:
            gossip()
        case _:
            sys.exit("expected sums or gossip")

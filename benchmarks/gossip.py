"""Costs of gossip in large networks, from the first message until every robot knows the graph, for docs/wide.md.

python -m benchmarks.gossip
"""

import time

from coheft.consensus.gossip import Gossip
from coheft.consensus.graph import build_graph
from coheft.wire.messages.codec import encode
from coheft.wire.messages.structs import NeighbourMessage
from coheft.wire.scenario.schema import Graph, GraphKind

KINDS: tuple[GraphKind, ...] = ("ring", "grid", "tree")


def main() -> None:
    """Print a line for each network."""
    print("graph robots blocks bytes-per-edge[B] largest-message[B] CPU-time-per-agent[ms]")
    for kind in KINDS:
        for count in (24, 100, 300, 1000):
            graph = build_graph(Graph(kind=kind), [f"r{k:05d}" for k in range(count)])
            robots = {name: Gossip(name, others) for name, others in graph.items()}
            sizes = []
            start = time.process_time()
            while any(robot.graph is None for robot in robots.values()):
                sent = {name: robot.news() for name, robot in robots.items()}
                message = NeighbourMessage(sender="r00000", block=1, gossip=sent["r00000"], channels={})
                sizes.append(len(encode(message, "key")))
                for name, others in graph.items():
                    for other in others:
                        robots[name].hear(sent[other])
            taken = (time.process_time() - start) / count
            print(f"{kind:5} {count:6} {len(sizes):6} {sum(sizes):9} {max(sizes):7} {1e3 * taken:8.1f}", flush=True)


if __name__ == "__main__":
    main()

"""What a robot takes from the graph for its sums."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from coheft.agents.fan2017.network import Network
from coheft.consensus.graph import Neighbours, build_graph
from coheft.wire.config import AgentConfig, agent_config
from coheft.wire.scenario.estimator_settings import Fan2017Settings
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import Graph
from tests.test_graph import names


def config_of(name: str, graph: Neighbours) -> AgentConfig:
    return replace(agent_config(load_scenario("ring3"), "r1", ()), name=name, neighbours=graph[name])


@pytest.mark.parametrize("weights", ["metropolis", "uniform"])
def test_both_ends_of_an_edge_give_it_the_same_weight(weights: str) -> None:
    team = names(7)
    graph = build_graph(Graph(kind="random", seed=1), team)
    settings = Fan2017Settings(consensus_weights=weights)  # type: ignore[arg-type]
    networks = {name: Network.of(replace(config_of(name, graph), fan2017=settings), graph) for name in team}
    for name, network in networks.items():
        assert set(network.gains) == set(graph[name])
        assert all(gain == networks[other].gains[name] for other, gain in network.gains.items())
    assert len({network.rate for network in networks.values()}) == 1

"""What a robot takes from the graph for its sums."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from coheft.agents.fan2017.network import Network
from coheft.consensus.graph import Neighbours, build_graph
from coheft.wire.config import AgentConfig, agent_config
from coheft.wire.scenario.estimator_settings import Fan2017Settings
from coheft.wire.scenario.file import available_scenarios, load_scenario
from coheft.wire.scenario.schema import Graph, Scenario
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


@pytest.mark.parametrize(("rounds", "extrapolate", "is_worth"), [(4, True, False), (8, True, True), (8, False, False)])
def test_sums_are_extrapolated_where_little_is_left_then(rounds: int, extrapolate: bool, is_worth: bool) -> None:
    team = names(6)
    graph = build_graph(Graph(kind="ring"), team)
    settings = Fan2017Settings(rounds=rounds, extrapolate=extrapolate)
    found = Network.of(replace(config_of(team[0], graph), fan2017=settings), graph)
    assert (found.extrapolation.factor > 0.0) == is_worth
    assert (found.extrapolation.left < 0.1) == is_worth


@pytest.mark.parametrize(
    ("robots", "rounds", "is_known"), [(6, 2, False), (6, 4, True), (4, 16, True), (12, 8, False), (12, 16, True)]
)
def test_after_few_rounds_the_lag_is_unknown(robots: int, rounds: int, is_known: bool) -> None:
    """In a ring of four extrapolation removes nothing at any number of rounds, but 16 leave nothing to be removed."""
    team = names(robots)
    graph = build_graph(Graph(kind="ring"), team)
    settings = Fan2017Settings(rounds=rounds)
    assert Network.of(replace(config_of(team[0], graph), fan2017=settings), graph).knows_lag == is_known


def test_in_every_scenario_the_lag_is_known() -> None:
    for name in available_scenarios():
        scenario = load_scenario(name)
        if isinstance(scenario, Scenario):
            graph = build_graph(scenario.graph, scenario.robot_names)
            robot, others = next(iter(graph.items()))
            assert Network.of(agent_config(scenario, robot, others), graph).knows_lag, name

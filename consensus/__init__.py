"""Consensus: sums over a network with one-hop messages, where each agent knows only its neighbours.

The functions and classes exported here work on arrays, a graph, and transports between coordinates; they need neither
robots nor a network, see docs/consensus.md. With ``coheft.consensus.gossip``, agents that know only their neighbours
learn the graph.
"""

from coheft.consensus.dynamic import DynamicConsensus, Extrapolation, lag_bound
from coheft.consensus.flood import Flood
from coheft.consensus.graph import (
    Neighbours,
    check_graph,
    convergence_rate,
    laplacian,
    metropolis_matrix,
    metropolis_weight,
    place_variances,
    weight_matrix,
)
from coheft.consensus.pipeline import NeighbourStages, Pipeline
from coheft.consensus.rounds import Rounds, make_rounds
from coheft.consensus.schedule import Schedule, chebyshev, choose_schedule, finite_time, tree

__all__ = [
    "DynamicConsensus",
    "Extrapolation",
    "Flood",
    "NeighbourStages",
    "Neighbours",
    "Pipeline",
    "Rounds",
    "Schedule",
    "chebyshev",
    "check_graph",
    "choose_schedule",
    "convergence_rate",
    "finite_time",
    "lag_bound",
    "laplacian",
    "make_rounds",
    "metropolis_matrix",
    "metropolis_weight",
    "place_variances",
    "tree",
    "weight_matrix",
]

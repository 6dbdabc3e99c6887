"""Consensus: sums over a network with one-hop messages, among agents that know only their neighbours.

What is named here needs arrays, a graph, and transports between coordinates, and neither robots nor a network: see
docs/consensus.md. How agents that are told of nothing but their neighbours learn the graph is in
``coheft.consensus.gossip``.
"""

from coheft.consensus.dynamic import DynamicConsensus, lag_bound
from coheft.consensus.graph import (
    Neighbours,
    convergence_rate,
    laplacian,
    metropolis_matrix,
    metropolis_weight,
    weight_matrix,
)
from coheft.consensus.pipeline import NeighbourStages, Pipeline
from coheft.consensus.rounds import Rounds, make_rounds
from coheft.consensus.schedule import Schedule, chebyshev, choose_schedule, finite_time, tree

__all__ = [
    "DynamicConsensus",
    "NeighbourStages",
    "Neighbours",
    "Pipeline",
    "Rounds",
    "Schedule",
    "chebyshev",
    "choose_schedule",
    "convergence_rate",
    "finite_time",
    "lag_bound",
    "laplacian",
    "make_rounds",
    "metropolis_matrix",
    "metropolis_weight",
    "tree",
    "weight_matrix",
]

"""Consensus: sums over a network with one-hop messages, among agents that know their neighbours only."""

"""Consensus: sums over a network with one-hop messages, each agent in its own coordinates."""

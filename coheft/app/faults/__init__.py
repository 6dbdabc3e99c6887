"""Fault simulation: a whole team in one process, what goes wrong drawn from a seed, every promise checked all along."""

"""Fault injection: a whole team in one process, faults drawn from a seed, every promise checked after every block."""

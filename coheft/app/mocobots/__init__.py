"""The paper on mocobots, redone: its configurations, its tables, and what other methods make of the same data."""

"""Agents: one robot, one process. The core (``agents.agent``) is pure; ``agents.process`` gives it its links."""

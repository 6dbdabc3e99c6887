"""One robot, one process. The core (``coheft.agents.agent``) is pure; ``coheft.agents.process`` gives it its links."""

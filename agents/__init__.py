"""One robot as one process: the pure core ``coheft.agents.agent``, and ``coheft.agents.process`` with its links."""

"""One robot, one process: the pure core is ``coheft.agents.agent``, its shell ``coheft.agents.process``."""

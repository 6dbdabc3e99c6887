"""The default estimator of one robot: rows of the whole team, and what follows from them.

``exchange`` hands rows on from neighbour to neighbour, ``monitor`` says whose sensors contradict the team, ``session``
decides when what is fitted, ``estimator`` is the interface to the agent. The mathematics is
``coheft.estimation.moments``.
"""

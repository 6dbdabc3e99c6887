"""The default estimator of one robot: rows of the whole team, and what follows from them.

Read ``row_times`` (which samples are a row), ``exchange`` (rows are handed on from neighbour to neighbour),
``knowledge`` (rows, chapters before, and the fit), ``innovations`` (evaluates rows with it), ``monitor`` (whose sensors
contradict the team), ``judge`` (whether rows fit), ``stages`` and ``session`` (when what is done), ``settings`` (what
guards), ``team`` (all of this while the team is what it is, ``handover`` for robots that are new), ``estimator`` (the
interface to the agent).
The mathematics is ``coheft.estimation.moments``.
"""

"""The default estimator of one robot, from rows of the whole team.

Read in this order: ``settings`` (thresholds, times), ``row_times`` (which samples form a row), ``exchange`` (rows are
forwarded from neighbour to neighbour; ``seals``: robots sign them), ``knowledge`` (rows, prior and fit; ``pages``:
chapters of fixed length), ``innovations`` (residuals of rows at the fit), ``monitor`` and ``contradictions`` (which
robot's sensors contradict the team, and what becomes of rows then), ``change_test_schedule`` and ``change_detector``
(has the load changed?), ``one_load`` (where, and what a change makes wrong in a fit to all rows), ``small_steps``,
``gaps`` and ``unnoticed`` (changes that are too small to be noticed), ``judge`` (do all rows fit?) and ``acceptance``
(what follows if not, with ``undeclared_watch``), ``state_before_change``, ``slips`` and ``causes`` (a load change or a
slip?), ``load_drift``, ``stages`` and ``session`` (decides what to do with each row), ``team`` (all of this while the
team stays the same, with ``handover`` for robots that join), ``estimator`` (the interface to the agent). The
mathematics is in ``coheft.estimation.moments``.
"""

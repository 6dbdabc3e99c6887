"""The default estimator of one robot, from rows of the whole team.

Read ``row_times`` (which samples form a row), ``exchange`` (rows are forwarded from neighbour to neighbour; ``seals``:
robots sign them), ``knowledge`` (rows, prior and fit), ``innovations`` (residuals of rows at the fit), ``monitor``
(which robot's sensors contradict the team), ``change_detector`` (has the load changed? with ``looks``, ``small_steps``,
``gaps`` and ``confirmation``), ``judge`` (do all rows fit?) and ``acceptance`` (what follows if not, with
``tolerances`` and ``undeclared_watch``), ``causes`` (a load change or one of the ``slips``?), ``load_drift``,
``restlessness``, ``stages`` and ``session`` (decides what to do with each row), ``settings`` (thresholds, times),
``team`` (all of this while the team stays the same, with ``handover`` for robots that join), ``estimator`` (the
interface to the agent). The mathematics is in ``coheft.estimation.moments``.
"""

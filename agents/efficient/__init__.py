"""The default estimator of one robot, from rows of the whole team.

Read in this order: ``settings`` (thresholds, times), ``row_times`` (which samples form a row), ``exchange`` (rows are
forwarded from neighbour to neighbour; ``seals``: robots sign them), ``knowledge`` (rows, prior and fit; ``pages``:
chapters of fixed length), ``innovations`` (residuals of rows at the fit), ``contradictions`` (which robot's sensors
contradict the team, and what becomes of rows then), ``change_detector`` (has the load changed?), ``one_load`` (where,
and what a change makes wrong in a fit to all rows), ``unnoticed`` (changes that are too small to be noticed), ``judge``
(do all rows fit?) and ``acceptance`` (what follows if not), ``state_before_change``, ``slips`` and ``causes`` (a load
change or a slip?), ``load_drift``, ``stages`` and ``session`` (decides what to do with each row), ``team`` (all of this
while the team stays the same, with ``handover`` for robots that join), ``estimator`` (the interface to the agent). The
mathematics is in ``coheft.estimation.moments``, where more words are explained.

    number, index  a row's number counts time, the same for all robots; its index is its place in this robot's buffer
    look           a test for a change of the load: first at fixed poses, then against a fit to the rows before
    confirm        show by new rows that the load is still the same, after rows were missing or in another team
    step, drift    a change of the mass that was too small to be noticed; changes that follow each other (leaks)
    gap            missing rows, in which anything may have changed
    suspicion      a change of which it is not known yet whether it is of the load, of a grasp or of a sensor
    page           a chapter of fixed length, where sensors drift or the load is forgotten
    past           the mean row of earlier chapters, for mean residuals
"""

"""A team's poses, sensor errors and load by linear algebra on second moments of rows.

Read in this order: ``rows`` (samples become rows), ``sensor_errors`` and ``unknowns`` (the parameters), ``body``
(motion and total wrench from rows), ``moments`` and ``row_buffer`` (what is stored of rows), ``derivatives`` and
``likelihood`` (score and information from moments), ``evidence`` (a quadratic log likelihood with the noise of its
regressors), ``fit_settings``, ``start`` and ``fit`` (maximum likelihood), ``chapter`` (priors across changes),
``change`` and ``change_at_fit`` (has the load changed?), ``beside_fit`` (what rows show of some unknowns alone),
``pose_steps`` (has a pose changed?), ``misfit`` and ``hidden_poses`` (do rows fit?),
``misread`` (would they, if one robot's wrenches were read otherwise?), ``suspects`` (what has changed?), ``widening``
(do tolerances prove too small?), ``undeclared`` (are there errors that no tolerance allows for?), ``claims`` (what may
be published), ``recorded`` (all of this for a recording).

Words that all of these files use:

    extended row   the rows of all robots, 1, then rates and flexing if there are any: ``x``, of length ``X``
    motion, psi    motion of the body in one row, fused from all robots; its numbers are the features
    view           what the wrench of a row depends on, and the total wrench: ``(motion[FORCING], wrench)``
    eta            sensor errors of a robot; its calibration is the matrix that corrects its extended row by them
    anchor         the robot whose pose is fixed, and fixes the body frame
    evidence       quadratic log likelihood; ``noise`` is known and subtracted, ``doubt`` is how uncertain that is
    seen, hidden   directions of the unknowns with and without enough information, as ``limits`` (deviations) define it
    guess          a rough load, which sets the limits of theta
    chapter        the rows since something has changed; what was known before is its prior
    expectations   the prior of sensor errors, by their tolerances

Pure: arrays in, arrays out. It may import the rest of ``coheft.estimation``, and nothing else of coheft.
"""

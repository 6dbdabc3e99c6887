"""A team's poses, sensor errors and load by linear algebra on second moments of rows.

Read in this order: ``rows`` and ``flexing`` (samples become rows), ``sensor_errors`` and ``unknowns`` (the parameters),
``corrections`` and ``body`` (motion and total wrench from rows), ``moments``, ``projected`` and ``row_buffer`` (what is
stored of rows), ``derivatives`` and ``likelihood`` (score and information from moments), ``evidence`` (a quadratic log
likelihood with the noise of its regressors), ``fit_settings``, ``start`` and ``fit`` (maximum likelihood), ``chapter``
(priors across changes), ``change`` (has the load changed?), ``misfit`` and ``hidden_poses`` (do rows fit?),
``suspects`` and ``slip_residuals`` (what has changed?), ``widening`` (do tolerances prove too small?), ``undeclared``
and ``late_sensors`` (are there errors that no tolerance allows for?), ``claims`` and ``found_errors`` (what may be
published), ``recorded`` (all of this for a recording).

Pure: arrays in, arrays out. It may import the rest of ``coheft.estimation``, and nothing else of coheft.
"""

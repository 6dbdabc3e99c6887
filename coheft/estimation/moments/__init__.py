"""A team's poses, sensors' errors and load by linear algebra on second moments of rows.

Read in this order: ``rows`` (what a block becomes), ``unknowns`` and ``sensor_errors`` (what is estimated), ``body``
(what rows say of the motion), ``moments``, ``projected`` and ``row_buffer`` (what is kept of rows), ``derivatives`` and
``likelihood`` (what moments say of the unknowns), ``evidence`` (a quadratic that knows its noise), ``fit_settings``,
``start`` and ``fit`` (the likeliest state), ``chapter`` (what stays when something changes), ``change`` (whether the
load has changed), ``misfit`` (whether rows fit), ``claims`` (what may be said), ``recorded`` (all of this for a
recording).

Pure: arrays in, arrays out. It may import the rest of ``coheft.estimation``, and nothing else of coheft.
"""

"""The report of a run as a page, with pictures and data; ``folder`` writes it, ``series`` gathers what is in it."""

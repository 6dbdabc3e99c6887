"""How any process of a run begins, reports problems and ends."""

"""Motion of one robot: reference motions that make the load observable, and the common path for carrying it."""

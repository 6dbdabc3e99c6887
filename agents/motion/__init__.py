"""How one robot moves: reference motions that show the load, and the common path along which it is carried."""

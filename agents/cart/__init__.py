"""One robot that pushes a cart together with others: the pure core and its process."""

"""Mass properties of one rigid body, its equations of motion, and what motion shows of them."""

"""Mass properties of one rigid body, its equations of motion, and their observability."""

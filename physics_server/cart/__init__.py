"""A cart in MuJoCo, and the process that simulates it."""

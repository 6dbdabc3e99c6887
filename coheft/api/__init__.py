"""The Python interface: runs, their results, scenarios and identification."""

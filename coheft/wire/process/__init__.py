"""Start, problem reports and end of a process of a run."""

"""What ``import coheft`` offers: runs, their results, scenarios and identification, for programs in Python."""

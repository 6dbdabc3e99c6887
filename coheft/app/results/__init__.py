"""Records of a run, and comparison of estimates with the truth."""

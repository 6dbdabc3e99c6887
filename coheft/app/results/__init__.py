"""What is kept of a run, and how estimates are judged against the truth."""

"""From a recording on disk to a report: the shell around ``coheft.estimation.batch``."""

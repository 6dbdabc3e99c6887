"""Studies: many runs that compare the estimators with the Cramér-Rao bounds."""

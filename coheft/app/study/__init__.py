"""Campaigns of many runs that measure the estimators against the bounds."""

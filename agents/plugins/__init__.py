"""Estimators and motions of the user's own, found by their entry points and checked."""

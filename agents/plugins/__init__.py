"""The user's own estimators and motions: found by their entry points, and checked."""

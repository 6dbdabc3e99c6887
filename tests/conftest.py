"""Settings that all tests share."""

from __future__ import annotations

from hypothesis import settings

# Always the same examples, so a test that passed once passes everywhere; no deadline, because machines differ.
settings.register_profile("coheft", derandomize=True, deadline=None, max_examples=60, database=None)
settings.load_profile("coheft")

"""How far a robot is, in the words that tables and the view show."""

from __future__ import annotations

from coheft.wire.messages.structs import Estimate

STATES = ("stale", "finding neighbours", "weighing", "converged")
"""The worst first."""


def state_of(estimate: Estimate) -> str:
    """One of ``STATES``, by what the robot says of itself."""
    if estimate.status == "stale":
        return "stale"
    if estimate.phase == "poses":
        return "finding neighbours"
    return "converged" if estimate.is_converged else "weighing"

"""States of a robot, the same in terminal, view, reports, JSON and documentation."""

from __future__ import annotations

from enum import StrEnum

from coheft.wire.messages.structs import Estimate, Validity


class State(StrEnum):
    """A robot's state by its own report; the worst first."""

    STALE = "stale"
    FINDING_NEIGHBOURS = "finding neighbours"
    WEIGHING = "weighing"
    MASS_KNOWN = "mass known"
    CENTRE_KNOWN = "centre known"
    ALL_KNOWN = "all known"
    CONVERGED = "converged"

    @staticmethod
    def of(estimate: Estimate) -> State:
        """Return the state that the estimate reports, whether or not the estimate is correct."""
        if estimate.status is Validity.STALE:
            return State.STALE
        if estimate.phase == "poses" and estimate.payload is None:
            return State.FINDING_NEIGHBOURS
        payload = estimate.payload
        if payload is None:
            return State.WEIGHING
        if payload.com is None:
            return State.MASS_KNOWN
        if payload.tensor is None:
            return State.CENTRE_KNOWN
        return State.CONVERGED if estimate.is_converged else State.ALL_KNOWN


MEANINGS = {
    State.STALE: "cannot tell whether its estimate still holds",
    State.FINDING_NEIGHBOURS: "does not yet know where its neighbours hold the payload",
    State.WEIGHING: "knows nothing about the payload yet",
    State.MASS_KNOWN: "knows the mass only",
    State.CENTRE_KNOWN: "knows mass and centre of mass",
    State.ALL_KNOWN: "knows everything, but not accurately enough yet",
    State.CONVERGED: "knows everything accurately enough",
}
LACKS = {
    State.FINDING_NEIGHBOURS: "the poses of neighbours are still being found",
    State.WEIGHING: "the mass is still being found",
    State.MASS_KNOWN: "the centre of mass is still being found",
    State.CENTRE_KNOWN: "the inertia is still being found",
    State.ALL_KNOWN: "all is known, but its std is not yet as small as [converged] in the scenario asks for",
}
"""What is missing until a robot converges; a stale one gives its own reason."""

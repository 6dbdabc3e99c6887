"""How far a robot is, and by which method: one word for it in terminal, view, reports, JSON and documentation."""

from __future__ import annotations

from enum import StrEnum

from coheft.wire.messages.structs import Estimate

ESTIMATORS = {
    "efficient": "efficient, which reaches the Cramér-Rao bound",
    "fan2017": "fan2017, the method of Fan et al. (CDC 2017)",
}
"""Those that come with coheft, and what they are."""


class State(StrEnum):
    """What a robot says of itself; the worst first."""

    STALE = "stale"
    FINDING_NEIGHBOURS = "finding neighbours"
    WEIGHING = "weighing"
    MASS_KNOWN = "mass known"
    CENTRE_KNOWN = "centre known"
    ALL_KNOWN = "all known"
    CONVERGED = "converged"

    @staticmethod
    def of(estimate: Estimate) -> State:
        """By what the robot says of itself, not by how right it is."""
        if estimate.status == "stale":
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
"""What a robot lacks that has not converged; one that is stale gives its own reason."""

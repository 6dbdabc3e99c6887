"""Rules for arms: they have to hold the payload and all loads that are added to it, and not throw it."""

from collections.abc import Iterator

import numpy as np

from coheft.estimation.geometry.spatial import Pose
from coheft.estimation.rigid_body.mass_properties import Inertia, combined
from coheft.wire.scenario.grasps import place_grasps
from coheft.wire.scenario.rules import Complaint
from coheft.wire.scenario.schema import LoadChange, Scenario
from coheft.wire.scenario.stability import stability_complaints
from coheft.wire.scenario.strength import Strength


@np.errstate(all="ignore")
def arm_complaints(scenario: Scenario) -> list[Complaint]:
    """Complain about springs that throw the payload, or let it fall."""
    robots, payload = scenario.robots, scenario.payload.inertia()
    try:
        if complaints := list(stability_complaints(scenario)):
            return complaints
        strength = Strength.of(place_grasps(scenario), robots)
        return [] if strength is None else list(_weight_complaints(scenario, payload, strength))
    except np.linalg.LinAlgError:
        complaint = (
            f"found {list(robots.stiffness)}, 'robots.damping' = {list(robots.damping)} and a payload of "
            f"{payload.mass:g} kg: their motion cannot be computed; expected smaller or larger numbers"
        )
        return [("robots.stiffness", complaint)]


def _weight_complaints(scenario: Scenario, payload: Inertia, strength: Strength) -> Iterator[Complaint]:
    """Complain about the payload, or each load together with the loads present when it is added."""
    if complaint := strength.complaint(payload):
        yield "payload", f"found {payload.mass:g} kg, which is {complaint}"
        return
    there: dict[int, LoadChange] = {}
    number = 0
    for index, change in sorted(enumerate(scenario.load_changes), key=lambda each: each[1].at):
        if change.remove is not None:
            there.pop(change.remove, None)
            continue
        before = combined([payload, *(_left(load, change.at) for load in there.values())])
        if complaint := strength.complaint(_left(change, change.at), before):
            found = f"found {change.mass:g} kg at {list(change.position)} m"
            yield f"load_changes[{index}].mass", f"{found}, which is {complaint}"
            return
        number += 1
        there[number] = change


def _left(load: LoadChange, time: float) -> Inertia:
    """Return the part of a load that has not leaked out at a time."""
    mass = max(0.0, (load.mass or 0.0) - load.leak * (time - load.at))
    return Inertia.of_box(mass, load.size, Pose(np.eye(3), np.array(load.position)))

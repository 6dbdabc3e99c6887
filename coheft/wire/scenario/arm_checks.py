"""Checks that the arms of a scenario can hold the payload, and all loads that are added to it."""

from __future__ import annotations

import numpy as np

from coheft.errors import ScenarioError
from coheft.estimation.geometry.spatial import Pose
from coheft.estimation.rigid_body.mass_properties import Inertia, combined
from coheft.wire.scenario.grasps import place_grasps
from coheft.wire.scenario.schema import LoadChange, Scenario
from coheft.wire.scenario.stability import check_stability
from coheft.wire.scenario.strength import Strength


def check_arms(scenario: Scenario, origin: str) -> None:
    """Check that the arms' springs neither throw the payload nor let it fall.

    Raises:
        ScenarioError: They do.
    """
    robots, payload = scenario.robots, scenario.payload.inertia()
    try:
        with np.errstate(all="ignore"):
            grasps = place_grasps(scenario)
            check_stability(scenario, grasps, origin)
            strength = Strength.of(grasps, robots)
            if strength is not None:
                _check_weights(scenario, payload, strength, origin)
    except np.linalg.LinAlgError as error:
        raise ScenarioError(
            f"{origin}: key 'robots.stiffness': found {list(robots.stiffness)}, 'robots.damping' = "
            f"{list(robots.damping)} and a payload of {payload.mass:g} kg: their motion cannot be computed; expected "
            f"smaller or larger numbers"
        ) from error


def _check_weights(scenario: Scenario, payload: Inertia, strength: Strength, origin: str) -> None:
    """Check the payload, then each load together with the loads present when it is added."""
    complaint = strength.complaint(payload)
    if complaint:
        raise ScenarioError(f"{origin}: key 'payload': found {payload.mass:g} kg, which is {complaint}")
    there: dict[int, LoadChange] = {}
    number = 0
    for index, change in sorted(enumerate(scenario.load_changes), key=lambda each: each[1].at):
        if change.remove is not None:
            there.pop(change.remove, None)
            continue
        before = combined([payload, *(_left(load, change.at) for load in there.values())])
        complaint = strength.complaint(_left(change, change.at), before)
        if complaint:
            raise ScenarioError(
                f"{origin}: key 'load_changes[{index}].mass': found {change.mass:g} kg at {list(change.position)} m, "
                f"which is {complaint}"
            )
        number += 1
        there[number] = change


def _left(load: LoadChange, time: float) -> Inertia:
    """Return the part of a load that has not leaked out at a time."""
    mass = max(0.0, (load.mass or 0.0) - load.leak * (time - load.at))
    return Inertia.of_box(mass, load.size, Pose(np.eye(3), np.array(load.position)))

"""Rules for arms: they have to hold the payload and all loads that are added to it, and not throw it."""

from collections.abc import Iterator

import numpy as np

from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.mass_properties import Inertia, combined
from coheft.wire.scenario.change_checks import loads_over_time
from coheft.wire.scenario.rules import Complaint, rounded_down
from coheft.wire.scenario.schema import PHYSICS_RATE, LoadChange, Scenario
from coheft.wire.scenario.strength import Strength, gains_at_payload

_ROUNDING = 1e-6


@np.errstate(all="ignore")
def arm_complaints(scenario: Scenario) -> list[Complaint]:
    """Complain about springs that throw the payload, or let it fall."""
    robots, payload = scenario.robots, scenario.payload.inertia()
    try:
        if complaints := list(stability_complaints(scenario)):
            return complaints
        strength = Strength.of(scenario.robots.poses(), robots)
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
    for index, change, there in loads_over_time(scenario):
        if change.remove is None:
            before = combined([payload, *(_left(load, change.at) for load in there.values())])
            if complaint := strength.complaint(_left(change, change.at), before):
                found = f"found {change.mass:g} kg at {list(change.position)} m"
                yield f"load_changes[{index}].mass", f"{found}, which is {complaint}"
                return


def _left(load: LoadChange, time: float) -> Inertia:
    """Return the part of a load that has not leaked out at a time."""
    mass = max(0.0, (load.mass or 0.0) - load.leak * (time - load.at))
    return Inertia.of_box(mass, load.size, Pose(np.eye(3), np.array(load.position)))


def stability_complaints(scenario: Scenario) -> Iterator[Complaint]:
    """Complain about arms that are too stiff, or damped too strongly, for the time step of the physics, and name values
    with which the simulation would be stable. Seven-joint arms are not checked.
    """
    payload, robots = scenario.payload.inertia(), scenario.robots
    if robots.arms == "seven-joint":
        return
    mass, grasps = payload.spatial(), scenario.robots.poses()
    springs = np.linalg.solve(mass, gains_at_payload(grasps, robots.stiffness)).astype(np.float64)
    dampers = np.linalg.solve(mass, gains_at_payload(grasps, robots.damping)).astype(np.float64)
    if _growth(springs, dampers) <= 1.0 + _ROUNDING:
        return
    # With dampers that stop a motion in at least one step, no oscillation grows from step to step.
    share = min(1.0, PHYSICS_RATE / float(np.abs(np.linalg.eigvals(dampers)).max(initial=1e-300)))
    while _growth(share * springs, share * dampers) > 1.0 + _ROUNDING:
        share *= 0.5
    yield (
        "robots.stiffness",
        f"the robots' arms are too stiff, or damped too strongly, for so light a payload ({payload.mass:.3g} kg): the "
        f"simulation would be unstable. Found robots.stiffness = {_in_file(robots.stiffness)} and robots.damping = "
        f"{_in_file(robots.damping)}; {_in_file(robots.stiffness, share)} and {_in_file(robots.damping, share)} would "
        f"work",
    )


def _growth(springs: Array, dampers: Array) -> float:
    """Largest growth of a small motion in a step of Euler's method, from ``M^-1 K`` and ``M^-1 D``, (6, 6) each."""
    period, one = 1.0 / PHYSICS_RATE, np.eye(6)
    velocity = np.hstack([-period * springs, one - period * dampers])
    step = np.vstack([np.hstack([one, np.zeros((6, 6))]) + period * velocity, velocity])
    return float(np.abs(np.linalg.eigvals(step)).max())


def _in_file(gains: tuple[float, float], share: float = 1.0) -> str:
    """Format a value as in a scenario's file; rounded down to two digits if it is scaled."""
    shown = (gain if share == 1.0 else rounded_down(share * gain) for gain in gains)
    return f"[{', '.join(f'{gain:g}' for gain in shown)}]"

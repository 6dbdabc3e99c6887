"""The rule that arms are not too stiff, or damped too strongly, for the time step of the physics."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from coheft.estimation.geometry.spatial import Array, Pose
from coheft.wire.scenario.grasps import place_grasps
from coheft.wire.scenario.rules import Complaint
from coheft.wire.scenario.schema import PHYSICS_RATE, Scenario

_ROUNDING = 1e-6


def stability_complaints(scenario: Scenario) -> Iterator[Complaint]:
    """Complain about arms with which the simulation would be unstable, and name values with which it would not.

    Seven-joint arms are not checked.
    """
    payload, robots = scenario.payload.inertia(), scenario.robots
    if robots.arms == "seven-joint":
        return
    mass, grasps = payload.spatial(), place_grasps(scenario)
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
        f"the robots' arms are too stiff, or damped too strongly, for so light a payload ({payload.mass:.3g} kg): it "
        f"would fly apart. Found robots.stiffness = {_in_file(robots.stiffness)} and robots.damping = "
        f"{_in_file(robots.damping)}; {_in_file(robots.stiffness, share)} and {_in_file(robots.damping, share)} would "
        f"do",
    )


def gains_at_payload(grasps: Sequence[Pose], gains: tuple[float, float]) -> Array:
    """Return the sum of all arms' gains (translation, rotation) for the payload's twist ``(w, v)``, shape (6, 6)."""
    at_grasp = np.repeat([gains[1], gains[0]], 3)
    adjoints = [grasp.inverse().adjoint() for grasp in grasps]
    result: Array = np.sum([adjoint.T @ (at_grasp[:, None] * adjoint) for adjoint in adjoints], axis=0)
    return result


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


def rounded_down(value: float) -> float:
    """Round to two digits; 0 if there are none."""
    if not 0.0 < value < math.inf:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return math.floor(value / unit) * unit

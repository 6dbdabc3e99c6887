"""What a robot publishes of load and poses: only what is known, in its own grasp frame.

(m, h, J) in F_i,    covariance = D P D^T,    published as far as all directions are seen: 0, 1, 4 or 10 numbers

While any pose is less certain than ``CLAIM_LIMITS``, at most the mass is published.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.linear_algebra import inverse as inverse_of
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.sensor_errors import DELAYS, SensorErrors
from coheft.estimation.moments.unknowns import THETA, Flags
from coheft.estimation.rigid_body.consistency import is_possible, nearest_possible
from coheft.estimation.rigid_body.derivatives import central_derivative, seen_inertia_derivative
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.estimation.rigid_body.unobservable import Unobservable, unobservable_quantities
from coheft.estimation.tolerance import AXES, PAIRS

CLAIM_LIMITS: Array = np.repeat([np.radians(2.0), 0.04], 3)
"""Poses are published once they are known to this [rad, m]: errors of five deviations are then still linear."""

_SURELY_NEGATIVE = 5.0
"""A mass that is negative by so many of its standard deviations is so by no chance."""


@dataclass(frozen=True, eq=False)
class Claim:
    """What one robot may publish.

    Attributes:
        inertia: The load in ``F_i``, None if not even its mass is known; only its first ``known`` numbers are valid.
        known: How many numbers of ``(m, h, J)`` are known: 0, 1, 4 or 10.
        covariance: Their covariance, shape (known, known).
        unobservable: What is not known, and which motion would show it, in words.
        hidden_poses: Whether each robot's pose is less certain than ``CLAIM_LIMITS``, shape (N,).
    """

    inertia: Inertia | None
    known: int
    covariance: Array
    unobservable: tuple[str, ...]
    hidden_poses: Flags


def claim_of(estimate: Estimate, robot: int) -> Claim:
    """Return what a robot of the team may publish of an estimate, in its own frame."""
    state, unknowns = estimate.state, estimate.body.unknowns
    hidden = estimate.hidden_poses(CLAIM_LIMITS)
    if state.load is None:
        return Claim(None, 0, np.zeros((0, 0)), (), hidden)
    covariance, inertia, pose = estimate.covariance, possible_load(estimate), state.poses[robot]
    derivative = seen_inertia_derivative(pose, inertia)
    derivative[:, 6:] = derivative[:, 6:] @ central_derivative(inertia)
    indices = np.concatenate([unknowns.poses[robot], np.arange(unknowns.size)[unknowns.theta]])
    covariance = derivative @ covariance[np.ix_(indices, indices)] @ derivative.T
    unobservable = unobservable_quantities(covariance, inertia.mass, estimate.guess.size)
    quantities = {each.quantity for each in unobservable}
    known = 0 if "mass" in quantities else 1 if "com" in quantities else 4 if "inertia" in quantities else 10
    if hidden.any():
        known = min(known, 1)
    words = tuple(f"{each.what}: {_remedy(each, estimate)}" for each in unobservable)
    mass = float(state.fitted_load[THETA.start])
    if not known and mass < -_SURELY_NEGATIVE * np.sqrt(estimate.variance_of_mass):
        words = (f"mass: wrenches show {mass:.3g} kg, so they seem to have the opposite sign: give those on the load",)
    return Claim(
        inertia.transported(pose.inverse()) if known else None, known, covariance[:known, :known], words, hidden
    )


def _remedy(unobservable: Unobservable, estimate: Estimate) -> str:
    """Say what would show a quantity: other motions, if all robots measure the wrenches that it needs."""
    is_there = np.isfinite(np.sum(estimate.body.noise.wrench, axis=0))
    if not is_there[:3].all():
        return "no motion shows it while a robot that holds the load does not measure its force"
    if unobservable.quantity == "inertia" and not is_there.all():
        return "no motion shows it while a robot that holds the load does not measure its torque"
    return unobservable.remedy


def possible_load(estimate: Estimate) -> Inertia:
    """Return the likeliest physically possible load, in the body frame; the estimate must have a load."""
    theta, indices = estimate.state.fitted_load[THETA], estimate.body.unknowns.theta
    if not is_possible(theta):
        theta = nearest_possible(theta, inverse_of(estimate.covariance[indices, indices]), estimate.guess.size)
    return Inertia.from_barycentric(theta)


class FoundError(NamedTuple):
    """One error of one robot's sensors.

    Attributes:
        key: Key of ``SensorTolerance``.
        axis: ``x``, ``y``, ``z``, two of them for cross-talk, empty if it has none.
        value: Estimate in the unit of the key.
        std: Its standard deviation.
        told: Its tolerance.
    """

    key: str
    axis: str
    value: float
    std: float
    told: float


def found_errors(estimate: Estimate, robot: int, declared: SensorErrors) -> list[FoundError]:
    """Return the errors of a robot's sensors by an estimate, in the order of the unknowns.

    The error of a sensor is ``-eta``, its delay ``eta``. The tolerances told are those of ``declared``, which has the
    same parameters as the estimate.

    Offsets of gyros, forces and torques are missing: only their sums over the team are known. Clocks are relative to
    that of the robot that fixed the body frame at first.
    """
    unknowns = estimate.body.unknowns
    indices, tolerances = unknowns.eta[robot], np.broadcast_to(declared.deviations, unknowns.eta.shape)
    deviations: Array = np.sqrt(np.maximum(estimate.covariance[indices, indices], 0.0))
    found, axes = list[FoundError](), dict.fromkeys(declared.names, 0)
    for name, eta, std, told in zip(
        declared.names, estimate.state.eta[robot], deviations, tolerances[robot], strict=True
    ):
        if name == "clock":
            told = declared.tolerances[robot % len(declared.tolerances)].get(name, 0.0)
        if told == 0.0:
            continue
        number, axes[name] = axes[name], axes[name] + 1
        key = "acceleration_offset" if name == "acceleration_bias" else name
        scale, axis = -1.0, (PAIRS if name.endswith("cross_talk") else AXES)[number]
        if name in (*DELAYS, "grasp_compliance") or name.endswith("_gain"):
            axis = ""
        if name in DELAYS:
            scale = 1.0
        if name.endswith("_mounting"):
            key, scale = f"{name}_deg", float(np.degrees(-1.0))
        found.append(FoundError(key, axis, scale * float(eta), abs(scale) * float(std), abs(scale) * float(told)))
    return found

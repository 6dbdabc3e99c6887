"""Estimated sensor errors in the terms of a data sheet, with standard deviation and tolerance.

error of a sensor = -eta,    delay of a sensor = eta
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.sensor_errors import DELAYS, SensorErrors
from coheft.estimation.tolerance import AXES, PAIRS


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

    The tolerances told are those of ``declared``, which has the same parameters as the estimate.

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

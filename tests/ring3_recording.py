"""What three simulated robots measure, as a recording by arrays."""

from __future__ import annotations

import msgspec
import numpy as np
import numpy.typing as npt

from coheft.app.study.samples import simulate
from coheft.estimation.measurement import ACCELERATION, FORCE, TORQUE, TWIST
from coheft.wire.scenario.file import load_scenario

MASS = 5.0
"""Of the load [kg]."""


def ring3_arrays(duration: float = 8.0) -> dict[str, npt.ArrayLike]:
    """Arrays by the names that an ``.npz`` file has for them."""
    scenario = msgspec.structs.replace(load_scenario("ring3"), duration=duration)
    samples = simulate(scenario).samples
    arrays: dict[str, npt.ArrayLike] = {"noise": scenario.noise.per_column()[::3]}
    for k, name in enumerate(scenario.robot_names):
        own = samples[:, k]
        moment_first = np.hstack([own[:, TORQUE], own[:, FORCE]])
        arrays |= {f"{name}/t": np.arange(len(own)) / scenario.sensors.rate, f"{name}/twist": own[:, TWIST]}
        arrays |= {f"{name}/acceleration": own[:, ACCELERATION], f"{name}/wrench": moment_first}
    return arrays

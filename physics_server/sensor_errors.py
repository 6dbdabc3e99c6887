"""The true errors of all robots' sensors, which no robot is told."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coheft.estimation.geometry.spatial import Array, rotation_exp
from coheft.estimation.measurement import SAMPLE_SIZE
from coheft.estimation.tolerance import SENSORS, SHAPES, SensorTolerance
from coheft.wire.scenario.schema import Scenario


@dataclass(frozen=True, eq=False)
class SensorErrors:
    """What the sensors of N robots make of what there is.

    Attributes:
        offsets: Of each column of a sample, shape (N, 15).
        matrices: What each sensor makes of what it should read, shape (N, 5, 3, 3).
        velocity_places, acceleration_places: Where these sensors are in the grasp frame, shape (N, 3) [m].
        delays: Of motion sensors and of wrenches, shape (N, 2) [s], none of them negative.
        compliances: Of grasps, shape (N,) [m/N], none of them negative.
    """

    offsets: Array
    matrices: Array
    velocity_places: Array
    acceleration_places: Array
    delays: Array
    compliances: Array

    @staticmethod
    def drawn(scenario: Scenario, count: int) -> SensorErrors:
        """Draw them, each robot from a random stream of its own: its errors do not depend on how many others there are.

        Only differences of delays between sensors matter to a team: the earliest of them all is not late.
        """
        told = scenario.sensor_errors
        streams = [
            np.random.default_rng(seed.spawn(1)[0]) for seed in np.random.SeedSequence(scenario.seed).spawn(count)
        ]
        offsets = told.offsets() * np.array([stream.standard_normal(SAMPLE_SIZE) for stream in streams])
        matrices = np.array([_drawn_matrices(told, stream) for stream in streams])
        places = np.array([stream.standard_normal((2, 3)) for stream in streams])
        late = np.array([stream.standard_normal(2) for stream in streams]) * [told.clock, told.wrench_delay]
        late[:, 1] += late[:, 0]
        compliances = told.grasp_compliance * np.abs([stream.standard_normal() for stream in streams])
        return SensorErrors(
            offsets,
            matrices,
            told.velocity_place * places[:, 0],
            told.acceleration_place * places[:, 1],
            late - late.min(),
            compliances,
        )


def _drawn_matrices(told: SensorTolerance, stream: np.random.Generator) -> Array:
    """One robot's true matrices, shape (5, 3, 3), sensors in the order of ``SENSORS``."""
    result = []
    for sensor in SENSORS:
        drawn = {shape: told.of(sensor, shape) * stream.standard_normal(len(each)) for shape, each in SHAPES.items()}
        mounting = rotation_exp(drawn.pop("mounting"))
        own = sum(np.tensordot(values, SHAPES[shape], axes=1) for shape, values in drawn.items())
        result.append((np.eye(3) + own) @ mounting)
    return np.array(result)

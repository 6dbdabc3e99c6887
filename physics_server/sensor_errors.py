"""The true errors of all robots' sensors, which the robots do not know."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coheft.estimation.geometry.spatial import Array, rotation_exp
from coheft.estimation.measurement import SAMPLE_SIZE
from coheft.estimation.tolerance import SENSORS, SHAPES, SensorTolerance
from coheft.wire.scenario.schema import Scenario


@dataclass(frozen=True, eq=False)
class SensorErrors:
    """Errors of the sensors of N robots.

    Attributes:
        offsets: Offset of each column of a sample, shape (N, 15).
        matrices: Factor from the true to the read vector of each sensor, shape (N, 5, 3, 3).
        velocity_places, acceleration_places: Positions of these sensors in the grasp frame, shape (N, 3) [m].
        delays: Delays of motion sensors and of wrenches, shape (N, 2) [s], not negative.
        compliances: Compliances of the grasps, shape (N,) [m/N], not negative.
    """

    offsets: Array
    matrices: Array
    velocity_places: Array
    acceleration_places: Array
    delays: Array
    compliances: Array

    @staticmethod
    def drawn(scenario: Scenario, count: int) -> SensorErrors:
        """Draw errors, each robot's from its own random stream, so that they do not depend on the number of robots.

        Only differences between the sensors' delays matter to a team, so the smallest delay is zero.
        """
        scales = scenario.robot_errors()
        streams = [
            np.random.default_rng(seed.spawn(1)[0]) for seed in np.random.SeedSequence(scenario.seed).spawn(count)
        ]
        each = list(zip(scales, streams, strict=True))
        offsets = np.array([scale.offsets() * stream.standard_normal(SAMPLE_SIZE) for scale, stream in each])
        matrices = np.array([_drawn_matrices(scale, stream) for scale, stream in each])
        spread = np.array([[[scale.velocity_place], [scale.acceleration_place]] for scale in scales])
        places = spread * np.array([stream.standard_normal((2, 3)) for stream in streams])
        late = np.array([stream.standard_normal(2) * [scale.clock, scale.wrench_delay] for scale, stream in each])
        late[:, 1] += late[:, 0]
        compliances = np.array([scale.grasp_compliance * abs(stream.standard_normal()) for scale, stream in each])
        return SensorErrors(
            offsets,
            matrices,
            places[:, 0],
            places[:, 1],
            late - late.min(),
            compliances,
        )


def _drawn_matrices(scale: SensorTolerance, stream: np.random.Generator) -> Array:
    """Draw one robot's matrices, shape (5, 3, 3), sensors in the order of ``SENSORS``."""
    result = []
    for sensor in SENSORS:
        drawn = {shape: scale.of(sensor, shape) * stream.standard_normal(len(each)) for shape, each in SHAPES.items()}
        mounting = rotation_exp(drawn.pop("mounting"))
        own = sum(np.tensordot(values, SHAPES[shape], axes=1) for shape, values in drawn.items())
        result.append((np.eye(3) + own) @ mounting)
    return np.array(result)

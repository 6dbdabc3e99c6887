"""The robots' grasps in a scenario."""

import numpy as np

from coheft.estimation.geometry.spatial import Pose, rotation_from_quaternion
from coheft.wire.scenario.schema import Scenario


def place_grasps(scenario: Scenario) -> tuple[Pose, ...]:
    """Return the true pose of each robot's grasp frame ``F_i`` in the payload's frame, in order of names."""
    perimeter = scenario.robots.perimeter
    if perimeter is None:
        return tuple(grasp.pose() for grasp in scenario.robots.grasps)
    # At equal distances along the rim, counter-clockwise, with uniformly distributed orientations.
    rng, (width, depth) = np.random.default_rng(perimeter.seed), perimeter.extent
    corners = np.array([[-width, -depth], [width, -depth], [width, depth], [-width, depth], [-width, -depth]]) / 2.0
    along = np.cumsum([0.0, width, depth, width, depth])
    grasps = []
    for distance in (np.arange(perimeter.count) + 0.5) / perimeter.count * 2.0 * (width + depth):
        x, y = (np.interp(distance, along, corners[:, axis]) for axis in (0, 1))
        quaternion = rng.standard_normal(4)
        height = rng.uniform(-perimeter.height, perimeter.height)
        rotation = rotation_from_quaternion(quaternion / np.linalg.norm(quaternion))
        grasps.append(Pose(rotation, np.array([x, y, height])))
    return tuple(grasps)

"""Random teams: a study of them shows how estimators perform on robots and loads that were not chosen by hand."""

from collections.abc import Sequence

import numpy as np

from coheft.estimation.tolerance import SensorTolerance
from coheft.wire.scenario.file import with_values
from coheft.wire.scenario.motion import Motion
from coheft.wire.scenario.payload import Box, Payload
from coheft.wire.scenario.schema import Graph, GraphKind, Perimeter, Robots, Scenario, Sensors

RANDOM = "random"
"""Name of a study in which every run has a different random team."""
_GRAPHS: tuple[GraphKind, ...] = ("ring", "line", "star", "complete", "random")
_MOST_ROBOTS = 8
_LONGEST = 600.0


def random_team(seed: int, values: Sequence[str] = ()) -> Scenario:
    """Return the team of a seed: two to eight robots that hold a plate with a lump on it, with any kind of graph.

    It raises a ``ScenarioError`` if a value is invalid.
    """
    rng = np.random.default_rng(seed)

    def number(least: float, most: float) -> float:
        return round(float(rng.uniform(least, most)), 3)

    width, depth = number(0.6, 1.4), number(0.4, 0.9)
    plate = Box(mass=number(2.0, 10.0), size=(width, depth, number(0.03, 0.2)))
    place = (number(-0.4, 0.4) * width, number(-0.4, 0.4) * depth, number(0.05, 0.15))
    lump = Box(mass=number(0.5, 5.0), size=(0.2, 0.15, 0.15), position=place)
    perimeter = Perimeter(count=int(rng.integers(2, _MOST_ROBOTS + 1)), extent=(width, depth), seed=seed)
    graph = Graph(kind=_GRAPHS[rng.integers(len(_GRAPHS))], edge_probability=number(0.1, 0.5), seed=seed)
    scenario = Scenario(
        name=f"{RANDOM}-{seed}",
        payload=Payload(boxes=(plate, lump)),
        robots=Robots(perimeter=perimeter),
        graph=graph,
        sensors=Sensors(tolerance=SensorTolerance()),
        motion=Motion(translation=number(0.03, 0.08), rotation=number(0.1, 0.4)),
        duration=_LONGEST,
        seed=seed,
    )
    return with_values(scenario, values)

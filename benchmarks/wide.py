"""A ring of 1,000 agents in one process against a ring of 24: does a robot cost more in a larger team?

The agents use the estimator fan2017, whose number of rounds of consensus does not depend on the team. They estimate
poses all the time, because robots of the long ring receive the sums of only a part of it.
"""

from __future__ import annotations

import statistics

from msgspec.structs import replace

from benchmarks.figures import Effort, Figure, Section, Skipped
from benchmarks.scenarios import team_scenario, weaker
from benchmarks.stepped_team import SteppedTeam
from benchmarks.timing import ratio

_SMALL, _LARGE = 24, 1000
_BAR = 1.2
_FIRST = 50
"""Number of blocks until every robot knows its neighbours, and estimates their poses."""
_TURNS: dict[Effort, int] = {"short": 0, "usual": 5, "full": 20}


def measure(effort: Effort) -> Section:
    """Measure both rings in turns."""
    title = f"A ring of {_LARGE} agents in one process"
    if not _TURNS[effort]:
        return Section(name="wide", title=title, figures=[], skipped=[Skipped("all of it", "it takes a minute")])
    small, large = (
        SteppedTeam(replace(weaker(team_scenario(robots)), estimator="fan2017")) for robots in (_SMALL, _LARGE)
    )
    for team in (small, large):
        team.run_until(_FIRST * team.block_duration)
    for _ in range(_TURNS[effort]):
        small.turn()
        large.turn()
    costs = [f"{1e6 * statistics.median(team.agents):.0f}" for team in (large, small)]
    cost = Figure(
        name=f"cost per agent and block, {_LARGE} against {_SMALL}",
        value=ratio(large.agents, small.agents),
        bar=_BAR,
        note=f"{' against '.join(costs)} µs; {large.block} blocks; phase: {', '.join(large.phases | small.phases)}",
    )
    physics = Figure(
        name="physics per block and robot, the same",
        value=ratio(large.physics, small.physics) * _SMALL / _LARGE,
        note=f"{1e3 * statistics.median(large.physics):.1f} ms a block",
    )
    return Section(name="wide", title=title, figures=[cost, physics])

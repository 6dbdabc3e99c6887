"""A ring of 1,000 agents in one process against a ring of 24: does a robot cost more in a larger team?

    python -m benchmarks.wide [--effort short|usual|full]

Both rings take turns, ten blocks each. The agents use the estimator fan2017, which does as many rounds of consensus in
any team. They look for their neighbours' poses all along; robots of the long ring hear the sums of their part of it
only.
"""

from __future__ import annotations

import statistics

from msgspec.structs import replace

from benchmarks.figures import Effort, Figure, Section, Skipped
from benchmarks.inprocess import TimedTeam
from benchmarks.runner import run_alone
from benchmarks.scenarios import team_scenario, weaker
from benchmarks.stepped_team import SteppedTeam
from benchmarks.timing import ratio

_SMALL, _LARGE = 24, 1000
_BAR = 1.2
_FIRST = 50
"""Blocks until every robot has heard of its neighbours, and looks for their poses."""
_TURNS: dict[Effort, int] = {"short": 0, "usual": 5, "full": 20}


def measure(effort: Effort) -> Section:
    """Both rings."""
    title = f"A ring of {_LARGE} agents in one process"
    if not _TURNS[effort]:
        return Section(name="wide", title=title, figures=[], skipped=[Skipped("all of it", "it takes a minute")])
    small, large = (TimedTeam(_stepped(robots), robots) for robots in (_SMALL, _LARGE))
    for team in (small, large):
        team.stepped.run_until(_FIRST * team.stepped.block_duration)
    for _ in range(_TURNS[effort]):
        for team in (small, large):
            team.turn()
    costs = [f"{1e6 * statistics.median(team.agents):.0f}" for team in (large, small)]
    phases = ", ".join(sorted(large.stepped.phases | small.stepped.phases))
    return Section(
        name="wide",
        title=title,
        figures=[
            Figure(
                name=f"cost per agent and block, {_LARGE} against {_SMALL}",
                value=ratio(large.agents, small.agents),
                bar=_BAR,
                note=f"{' against '.join(costs)} µs; {large.stepped.block} blocks; phase: {phases}",
            ),
            Figure(
                name="physics per block and robot, the same",
                value=ratio(large.physics, small.physics) * _SMALL / _LARGE,
                note=f"{1e3 * statistics.median(large.physics):.1f} ms a block",
            ),
        ],
    )


def _stepped(robots: int) -> SteppedTeam:
    return SteppedTeam(replace(weaker(team_scenario(robots)), estimator="fan2017"))


if __name__ == "__main__":
    run_alone("wide", __doc__)

"""Whole teams in one process on one core: simulated seconds per second of CPU time, with and without physics.

Teams run until every agent estimates the inertia; then they take turns. Unless stated otherwise, sensors sample at
1 kHz and a block has 20 samples.
"""

from __future__ import annotations

import statistics

from benchmarks.figures import Effort, Figure, Section
from benchmarks.scenarios import team_scenario
from benchmarks.stepped_team import SteppedTeam
from benchmarks.timing import ratio

_TURNS: dict[Effort, int] = {"short": 15, "usual": 25, "full": 50}
_BAR = 20.0
_SMALL, _LARGE = 6, 24
_LONGER = (100, 200)
"""Blocks with more samples: they cost nearly the same, but load changes are noticed later."""
_OLD = 60.0
"""Age of a team that fits its poses as rarely as it ever will [s]."""


def measure(effort: Effort) -> Section:
    """Measure all teams."""
    small, large = SteppedTeam(team_scenario(_SMALL)), SteppedTeam(team_scenario(_LARGE))
    teams = {f"ring of {_SMALL}": small, f"ring of {_LARGE}": large}
    if effort != "short":
        teams[f"ring of {_SMALL}, 500 Hz"] = SteppedTeam(team_scenario(_SMALL, 500, 10))
        for block in _LONGER:
            teams[f"ring of {_SMALL}, blocks of {block}"] = SteppedTeam(team_scenario(_SMALL, block=block))
    for team in teams.values():
        team.settle()
    if effort != "short":
        teams[f"ring of {_SMALL}, a minute old"] = old = SteppedTeam(team_scenario(_SMALL))
        old.run_until(_OLD)
    for _ in range(_TURNS[effort]):
        for team in teams.values():
            team.turn()
    figures = [
        *(figure for name, team in teams.items() for figure in _speeds(name, team, _BAR if team is small else None)),
        Figure(
            name=f"cost per agent and block, {_LARGE} against {_SMALL}",
            value=ratio(large.agents, small.agents),
            is_guarded=True,
            note=f"a ring's rounds grow with N: {_LARGE // 2} against {_SMALL // 2}",
        ),
        Figure(
            name=f"agents against physics, N = {_SMALL}",
            value=ratio(small.agents, small.physics) * _SMALL,
            is_guarded=True,
            note="CPU times",
        ),
    ]
    return Section(name="inprocess", title="Teams in one process, one core", figures=figures)


def _speeds(name: str, team: SteppedTeam, bar: float | None) -> list[Figure]:
    """Return how many times faster than real time a team is, with physics and without."""
    agent, physics = statistics.mean(team.agents), statistics.mean(team.physics)
    agents, note = agent * len(team.graph), f"{1e6 * agent:.0f} µs per agent and block"
    return [
        Figure(
            name=f"{name}, {what}",
            value=team.block_duration / seconds,
            unit="times real time",
            bar=bar,
            note=note,
            more_is_better=True,
        )
        for what, seconds, bar, note in (
            ("physics included", agents + physics, bar, f"{note}; physics {1e6 * physics:.0f} µs a block"),
            ("agents alone", agents, None, note),
        )
    ]

"""Whole teams in one process on one core: simulated seconds per second of CPU time, with and without physics.

    python -m benchmarks.inprocess [--effort short|usual|full]

Teams run until every agent weighs the load; then they take turns, ten blocks each. CPU time of agents and of physics is
counted separately. Sensors sample at 1 kHz and a block has 20 samples where nothing else is said.
"""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass, field
from typing import Literal

from msgspec.structs import replace

from benchmarks.figures import Effort, Figure, Section, Skipped
from benchmarks.runner import run_alone
from benchmarks.scenarios import team_scenario, weaker
from benchmarks.stepped_team import SteppedTeam
from benchmarks.timing import ratio
from coheft.wire.scenario.schema import Graph

_TURN = 10
_TURNS: dict[Effort, int] = {"short": 15, "usual": 25, "full": 50}
_BAR = 20.0
_SMALL, _LARGE = 6, 24
_LONGER = (100, 200)
"""A block costs nearly the same however many samples it has; with longer ones changes are noticed later."""
_OLD = 60.0
"""The older a team, the more seldom it fits its poses anew: from then on as seldom as ever, nearly [s]."""
_LARGER = (100, 300)
_KINDS: tuple[Literal["ring", "star"], ...] = ("ring", "star")
"""A ring's rounds grow with N, a star's do not, but its hub hears every robot."""
_LIMIT = 1200.0
"""A larger team is given up after so much CPU time [s]."""


@dataclass
class TimedTeam:
    """A team, and what each of its turns took.

    Attributes:
        stepped: The team.
        robots: How many.
        agents: CPU time per agent and block, a number for each turn [s].
        physics: CPU time of the physics per block, likewise [s].
    """

    stepped: SteppedTeam
    robots: int
    agents: list[float] = field(default_factory=list)
    physics: list[float] = field(default_factory=list)

    def turn(self) -> None:
        """Some blocks."""
        agents, physics = self.stepped.agents_time, self.stepped.physics_time
        for _ in range(_TURN):
            self.stepped.step()
        self.agents.append((self.stepped.agents_time - agents) / _TURN / self.robots)
        self.physics.append((self.stepped.physics_time - physics) / _TURN)

    def figures(self, name: str, bar: float | None = None) -> list[Figure]:
        """How fast it is."""
        agents, physics = statistics.mean(self.agents) * self.robots, statistics.mean(self.physics)
        note = f"{1e6 * agents / self.robots:.0f} µs per agent and block"
        return [
            Figure(
                name=f"{name}, physics included",
                value=self.stepped.block_duration / (agents + physics),
                unit="times real time",
                bar=bar,
                more_is_better=True,
                note=f"{note}; physics {1e6 * physics:.0f} µs a block",
            ),
            Figure(
                name=f"{name}, agents alone",
                value=self.stepped.block_duration / agents,
                unit="times real time",
                more_is_better=True,
                note=note,
            ),
        ]


def measure(effort: Effort) -> Section:
    """All teams."""
    small, large = (TimedTeam(SteppedTeam(team_scenario(robots)), robots) for robots in (_SMALL, _LARGE))
    teams = {f"ring of {_SMALL}": small, f"ring of {_LARGE}": large}
    if effort != "short":
        teams[f"ring of {_SMALL}, 500 Hz"] = TimedTeam(SteppedTeam(team_scenario(_SMALL, 500, 10)), _SMALL)
        for block in _LONGER:
            teams[f"ring of {_SMALL}, blocks of {block}"] = TimedTeam(
                SteppedTeam(team_scenario(_SMALL, block=block)), _SMALL
            )
    for team in teams.values():
        team.stepped.settle()
    if effort != "short":
        teams[f"ring of {_SMALL}, a minute old"] = old = TimedTeam(SteppedTeam(team_scenario(_SMALL)), _SMALL)
        old.stepped.run_until(_OLD)
    for _ in range(_TURNS[effort]):
        for team in teams.values():
            team.turn()
    figures = [
        *(figure for name, team in teams.items() for figure in team.figures(name, _BAR if team is small else None)),
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
            note="CPU time; physics is the yardstick here",
        ),
    ]
    skipped: list[Skipped] = []
    if effort == "full":
        for robots in _LARGER:
            for kind in _KINDS:
                _measure_larger(robots, Graph(kind=kind), figures, skipped)
    return Section(name="inprocess", title="Teams in one process, one core", figures=figures, skipped=skipped)


def _measure_larger(robots: int, graph: Graph, figures: list[Figure], skipped: list[Skipped]) -> None:
    """A team of hundreds, if it comes to work before it is given up."""
    name = f"{graph.kind} of {robots}"
    stepped = SteppedTeam(weaker(replace(team_scenario(robots), graph=graph)))
    deadline = time.process_time() + _LIMIT
    while not stepped.is_working and time.process_time() < deadline:
        stepped.step()
    if not stepped.is_working:
        simulated = stepped.block * stepped.block_duration
        reason = f"after {_LIMIT:.0f} s of CPU time it had simulated {simulated:.2f} s, and weighed no load yet"
        skipped.append(Skipped(name, reason))
        return
    team = TimedTeam(stepped, robots)
    for _ in range(5):
        team.turn()
    figures.extend(team.figures(name))


if __name__ == "__main__":
    run_alone("inprocess", __doc__)

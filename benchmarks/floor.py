"""The whole system against its bare floor: the same processes, links, messages and sizes without the mathematics.

    python -m benchmarks.floor [--effort short|usual|full]

The teams stand side by side and take turns of a second or two, while the others stand still. Agents of the floor
say what agents of the real team say in their thirteenth second; its server says the same measurements again and again.
Sensors sample at 1 kHz, blocks have 20 samples, the server waits for every robot. A third team shows what Zenoh alone
would take: two loops that say as many bytes, without the product's processes, checks and decoding.
"""

from __future__ import annotations

import statistics
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from benchmarks.bench_server import latencies
from benchmarks.figures import Effort, Figure, Section
from benchmarks.paced_team import Turn, paced_team
from benchmarks.raw_team import Sizes, raw_team
from benchmarks.replay import record, sizes
from benchmarks.runner import run_alone
from benchmarks.scenarios import team_scenario
from benchmarks.stepped_team import SETTLED
from benchmarks.timing import ratio
from coheft.app.run.plan import make_plan
from coheft.estimation.geometry.spatial import Array

SIZES = (6, 24)
BLOCK_BAR, AIM = 1.8, 1.5
_TURNS: dict[Effort, int] = {"short": 6, "usual": 10, "full": 30}
_TURN = {6: 1.0, 24: 2.0}
"""By size [s]."""
_MEASUREMENTS = 20 * 15 * 8 + 100
"""Size of a block of measurements with what is around it [B]."""
_EDGE = 5
"""Blocks at either end of a turn whose latency does not count: the team is just starting or stopping."""


def measure(effort: Effort) -> Section:
    """Full system against floor, for each size of a team."""
    figures = [figure for robots in SIZES for figure in _of_size(robots, _TURNS[effort])]
    return Section(name="floor", title="Full system against its bare floor", figures=figures)


def _of_size(robots: int, turns: int) -> list[Figure]:
    scenario = team_scenario(robots)
    full: list[Turn] = []
    floor: list[Turn] = []
    raw: list[Turn] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = record(scenario, folder)
        with paced_team(scenario, folder / "full") as real:
            real.run_until(SETTLED + 1.0)  # first, so that the other team finds other ports free
            with paced_team(scenario, folder / "floor", files) as bare:
                bare.run_until(1.0)
                message, answer = sizes(next(iter(files.values())))
                with raw_team(make_plan(scenario), Sizes(_MEASUREMENTS, message, answer)) as zenoh_alone:
                    zenoh_alone.turn(0.1)  # its links stand when it has answered
                    for _ in range(turns):
                        full.append(real.turn(_TURN[robots]))
                        floor.append(bare.turn(_TURN[robots]))
                        raw.append(zenoh_alone.turn(_TURN[robots]))
                bare.stop()
            real.stop()
        names = scenario.robot_names
        waits = [_within(latencies(folder / kind, names), done) for kind, done in (("full", full), ("floor", floor))]
    team = f"N = {robots}"
    return [*_figures(team, full, floor, *waits), *_against_raw(team, full, floor, raw)]


def _within(rows: Array, turns: Sequence[Turn]) -> Array:
    """Latencies [s] of the blocks inside of turns."""
    chosen = [(rows[:, 0] >= turn.first + _EDGE) & (rows[:, 0] < turn.first + turn.blocks - _EDGE) for turn in turns]
    found: Array = rows[np.any(chosen, axis=0), 1]
    return found[np.isfinite(found)]


def _figures(
    team: str, full: Sequence[Turn], floor: Sequence[Turn], full_waits: Array, floor_waits: Array
) -> list[Figure]:
    def against(quantity: Callable[[Turn], float]) -> tuple[float, str]:
        mine, its = [quantity(turn) for turn in full], [quantity(turn) for turn in floor]
        return ratio(mine, its), f"{1e3 * statistics.median(mine):.2f} against {1e3 * statistics.median(its):.2f} ms"

    time, time_note = against(lambda turn: turn.block_time)
    agent, agent_note = against(lambda turn: turn.agent_time)
    server, server_note = against(lambda turn: turn.server_time)
    rate = statistics.median(1.0 / turn.block_time for turn in full)
    floor_rate = statistics.median(1.0 / turn.block_time for turn in floor)
    figures = [
        Figure(
            name=f"time per block, {team}",
            value=time,
            bar=BLOCK_BAR,
            is_guarded=True,
            note=f"{rate:.0f} against {floor_rate:.0f} blocks/s; {time_note}; the aim is {AIM}",
        ),
        Figure(name=f"CPU time per agent and block, {team}", value=agent, is_guarded=True, note=agent_note),
        Figure(name=f"CPU time of the server per block, {team}", value=server, note=server_note),
    ]
    for share in (50, 99):
        mine, its = (1e3 * float(np.percentile(waits, share)) for waits in (full_waits, floor_waits))
        figures.append(
            Figure(
                name=f"latency of a block, p{share}, {team}",
                value=mine / its,
                note=f"{mine:.1f} against {its:.1f} ms, up to four blocks under way",
            )
        )
    return figures


def _against_raw(team: str, full: Sequence[Turn], floor: Sequence[Turn], raw: Sequence[Turn]) -> list[Figure]:
    """The real team and the floor, both against Zenoh alone."""
    rate = statistics.median(1.0 / turn.block_time for turn in raw)
    agent = 1e3 * statistics.median(turn.agent_time for turn in raw)
    note = f"Zenoh alone: {rate:.0f} blocks/s, {agent:.2f} ms of CPU time per agent and block"
    return [
        Figure(
            name=f"time per block of {name}, against Zenoh alone, {team}",
            value=ratio([turn.block_time for turn in turns], [turn.block_time for turn in raw]),
            note=note,
        )
        for name, turns in (("the full system", full), ("the bare floor", floor))
    ]


if __name__ == "__main__":
    run_alone("floor", __doc__)

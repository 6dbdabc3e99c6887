"""The whole system and its bare floor, both against Zenoh alone: what lies between the mathematics.

    python -m benchmarks.floor [--effort short|usual|full] [--json FILE]

Three teams stand side by side and take turns of a second or two, while the others stand still:

- the *whole* system, as users run it;
- its *bare floor*: the same processes, links, messages and sizes without mathematics and physics. Agents of the floor
  say what agents of the real team say in their thirteenth second; its server says the same measurements over and over;
- *Zenoh alone*: two loops that say as many bytes, without the product's processes, checks and decoding.

Sensors sample at 1 kHz, blocks have 20 samples, the server waits for every robot, up to four blocks ahead. At each turn
MuJoCo, in this process, takes the steps of some blocks, too.

Each ratio is the median over the turns. Those called ``…_over_zenoh`` are of time per block on the clock on the wall,
which is what a user waits for. ``…_over_zenoh_cpu`` are the same of the CPU time of all processes together: where other
work keeps the machine busy these are the ones to look at, and they are guarded, because of the clock a team with few
processes that want to run then gets a smaller share than one with many. Those of servers are of CPU time.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import mujoco
import numpy as np

from benchmarks.bench_server import latencies
from benchmarks.figures import Effort, Figure, Section, section_lines
from benchmarks.paced_team import Turn, paced_team
from benchmarks.raw_team import Sizes, raw_team
from benchmarks.replay import record, sizes
from benchmarks.runner import add_effort
from benchmarks.scenarios import BLOCK, RATE, team_scenario
from benchmarks.stepped_team import SETTLED
from benchmarks.timing import ratio
from coheft.app.run.plan import make_plan
from coheft.errors import CoheftError
from coheft.estimation.geometry.spatial import Array
from coheft.physics_server.simulation import Simulation
from coheft.wire.scenario.schema import PHYSICS_RATE, Scenario

SIZES = (6, 24)
WHOLE_BAR, SERVER_BAR, STEPS_BAR = 3.5, 1.6, 9.0
BARE_BAR = {6: 2.0, 24: 1.5}
"""By size."""
_TURNS: dict[Effort, int] = {"short": 6, "usual": 15, "full": 30}
_TURN = {6: 1.0, 24: 2.0}
"""By size [s]."""
_MEASUREMENTS = BLOCK * 15 * 8 + 100
"""Size of a block of measurements with what is around it [B]."""
_STEPPED = 50
"""Blocks that MuJoCo steps through at a turn."""
_EDGE = 5
"""Blocks at either end of a turn whose latency does not count: the team is just starting or stopping."""


class Ratios(msgspec.Struct, frozen=True, kw_only=True):
    """What the benchmark is about, medians over the turns; see the module for what each kind is made of.

    Attributes:
        whole_over_zenoh, bare_over_zenoh: Time per block.
        whole_over_zenoh_cpu, bare_over_zenoh_cpu: CPU time of all processes per block.
        server_over_bare_server: CPU time of the server per block, against the floor's, which says the same bytes.
        server_over_steps: The same against MuJoCo's steps of a block.
    """

    whole_over_zenoh: float
    bare_over_zenoh: float
    whole_over_zenoh_cpu: float
    bare_over_zenoh_cpu: float
    server_over_bare_server: float
    server_over_steps: float


@dataclass(frozen=True)
class Turns:
    """What each team did at its turns, and CPU times of MuJoCo's steps of a block beside them [s]."""

    whole: list[Turn]
    bare: list[Turn]
    zenoh: list[Turn]
    steps: list[float]

    def ratios(self) -> Ratios:
        """Medians."""

        def of(mine: Sequence[Turn], its: Sequence[Turn], quantity: Callable[[Turn], float]) -> float:
            return ratio([quantity(turn) for turn in mine], [quantity(turn) for turn in its])

        return Ratios(
            whole_over_zenoh=of(self.whole, self.zenoh, _wall),
            bare_over_zenoh=of(self.bare, self.zenoh, _wall),
            whole_over_zenoh_cpu=of(self.whole, self.zenoh, _cpu),
            bare_over_zenoh_cpu=of(self.bare, self.zenoh, _cpu),
            server_over_bare_server=of(self.whole, self.bare, _server),
            server_over_steps=ratio([turn.server_time for turn in self.whole], self.steps),
        )


def _wall(turn: Turn) -> float:
    return turn.block_time


def _cpu(turn: Turn) -> float:
    return turn.team_time


def _server(turn: Turn) -> float:
    return turn.server_time


def measure(effort: Effort) -> Section:
    """Both against Zenoh alone, for each size of a team."""
    return _section(effort)[0]


def _section(effort: Effort) -> tuple[Section, dict[str, Ratios]]:
    figures: list[Figure] = []
    ratios: dict[str, Ratios] = {}
    for robots in SIZES:
        found, waits = _of_size(robots, _TURNS[effort])
        ratios[str(robots)] = found.ratios()
        figures += _figures(robots, found, ratios[str(robots)], waits)
    return Section(name="floor", title="Whole system and bare floor against Zenoh alone", figures=figures), ratios


def _of_size(robots: int, turns: int) -> tuple[Turns, tuple[Array, Array]]:
    """Turns, and latencies [s] of blocks of the whole system and of the floor."""
    scenario = team_scenario(robots)
    found = Turns([], [], [], [])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = record(scenario, folder)
        steps = _stepper(scenario)
        with paced_team(scenario, folder / "whole") as real:
            real.run_until(SETTLED + 1.0)  # first, so that the other team finds other ports free
            with paced_team(scenario, folder / "bare", files) as bare:
                bare.run_until(1.0)
                message, answer = sizes(next(iter(files.values())))
                with raw_team(make_plan(scenario), Sizes(_MEASUREMENTS, message, answer)) as zenoh_alone:
                    zenoh_alone.turn(0.1)  # its links stand when it has answered
                    for _ in range(turns):
                        found.whole.append(real.turn(_TURN[robots]))
                        found.bare.append(bare.turn(_TURN[robots]))
                        found.zenoh.append(zenoh_alone.turn(_TURN[robots]))
                        found.steps.append(steps())
                bare.stop()
            real.stop()
        names = scenario.robot_names
        whole, floor = (
            _within(latencies(folder / kind, names), done)
            for kind, done in (("whole", found.whole), ("bare", found.bare))
        )
    return found, (whole, floor)


def _stepper(scenario: Scenario) -> Callable[[], float]:
    """What tells the CPU time of MuJoCo's steps of a block [s], with the arms at rest."""
    simulation = Simulation(scenario)
    steps = _STEPPED * BLOCK * PHYSICS_RATE // RATE

    def timed() -> float:
        began = time.process_time()
        mujoco.mj_step(simulation.model, simulation.data, nstep=steps)
        return (time.process_time() - began) / _STEPPED

    return timed


def _within(rows: Array, turns: Sequence[Turn]) -> Array:
    """Latencies [s] of the blocks inside of turns."""
    chosen = [(rows[:, 0] >= turn.first + _EDGE) & (rows[:, 0] < turn.first + turn.blocks - _EDGE) for turn in turns]
    found: Array = rows[np.any(chosen, axis=0), 1]
    return found[np.isfinite(found)]


def _figures(robots: int, found: Turns, ratios: Ratios, waits: tuple[Array, Array]) -> list[Figure]:
    team = f"N = {robots}"

    def note(mine: Sequence[Turn], its: Sequence[Turn], quantity: Callable[[Turn], float]) -> str:
        times = [1e3 * statistics.median(quantity(turn) for turn in turns) for turns in (mine, its)]
        return f"{times[0]:.2f} against {times[1]:.2f} ms"

    figures = []
    for name, turns, bar, wall, cpu in (
        ("the whole system", found.whole, WHOLE_BAR, ratios.whole_over_zenoh, ratios.whole_over_zenoh_cpu),
        ("the bare floor", found.bare, BARE_BAR[robots], ratios.bare_over_zenoh, ratios.bare_over_zenoh_cpu),
    ):
        figures += [
            Figure(
                name=f"time per block of {name}, against Zenoh alone, {team}",
                value=wall,
                bar=bar,
                note=note(turns, found.zenoh, _wall),
            ),
            Figure(
                name=f"CPU time per block of {name}, against Zenoh alone, {team}",
                value=cpu,
                is_guarded=True,
                note=f"{note(turns, found.zenoh, _cpu)}, all processes",
            ),
        ]
    steps = 1e3 * statistics.median(found.steps)
    figures += [
        Figure(
            name=f"CPU time of the server per block, against the floor's, {team}",
            value=ratios.server_over_bare_server,
            bar=SERVER_BAR if robots == SIZES[0] else None,
            is_guarded=True,
            note=note(found.whole, found.bare, _server),
        ),
        Figure(
            name=f"CPU time of the server per block, against MuJoCo's steps, {team}",
            value=ratios.server_over_steps,
            bar=STEPS_BAR if robots == SIZES[0] else None,
            note=f"of which a block takes {steps:.3f} ms",
        ),
        Figure(
            name=f"CPU time per agent and block, against the floor's, {team}",
            value=ratio([turn.agent_time for turn in found.whole], [turn.agent_time for turn in found.bare]),
            note=note(found.whole, found.bare, lambda turn: turn.agent_time),
        ),
    ]
    for share in (50, 99):
        mine, its = (1e3 * float(np.percentile(each, share)) for each in waits)
        figures.append(
            Figure(
                name=f"latency of a block, p{share}, against the floor's, {team}",
                value=mine / its,
                note=f"{mine:.1f} against {its:.1f} ms, up to four blocks under way",
            )
        )
    return figures


def main() -> None:
    """The command: measures, prints the table, and writes the ratios by size of the team if asked to."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.floor",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_effort(parser)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the ratios there, by number of robots")
    chosen = parser.parse_args()
    began = time.monotonic()
    try:
        section, ratios = _section(chosen.effort)
    except CoheftError as error:
        sys.exit(f"floor: {error}")
    except KeyboardInterrupt:
        sys.exit(130)
    print("\n".join(section_lines(msgspec.structs.replace(section, seconds=time.monotonic() - began))))
    if chosen.json is not None:
        chosen.json.write_bytes(msgspec.json.format(msgspec.json.encode(ratios)) + b"\n")


if __name__ == "__main__":
    main()

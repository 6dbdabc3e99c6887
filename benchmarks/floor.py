"""The whole system and its bare floor, both against Zenoh alone: what everything but the mathematics costs.

Three teams take turns of a second or two, while the others stand still:

- the *whole* system, as users run it;
- its *bare floor*: the same processes, links, messages and sizes without mathematics and physics. Its agents repeat
  the messages of the real team's thirteenth second; its server repeats the same measurements;
- *Zenoh alone*: two loops that send as many bytes, without the product's processes, checks and decoding.

Sensors sample at 1 kHz, blocks have 20 samples, and the server waits for every robot, up to four blocks ahead. At each
turn MuJoCo also steps through some blocks in this process.

Each ratio is the median over the turns. On a busy machine, ratios of CPU time are more reliable than those of
wall-clock time, because a team with few processes that are ready to run gets a smaller share than one with many; so
these are guarded.
"""

import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import msgspec
import mujoco

from benchmarks.command import run_command
from benchmarks.figures import Effort, Figure, Section, against, ratio, section_lines
from benchmarks.paced_team import SIZES, TURN, Turn, compared, paced_team
from benchmarks.raw_team import Sizes, raw_team
from benchmarks.replay import record, sizes
from benchmarks.scenarios import BLOCK, RATE, SETTLED, team_scenario
from coheft.app.run.plan import make_plan
from coheft.physics_server.simulation import Simulation
from coheft.wire.scenario.schema import PHYSICS_RATE, Scenario

WHOLE_BAR, SERVER_BAR, STEPS_BAR = 3.5, 1.6, 9.0
BARE_BAR = {6: 2.0, 24: 1.5}
"""By number of robots."""
_TURNS: dict[Effort, int] = {"short": 6, "usual": 15, "full": 30}
_MEASUREMENTS = BLOCK * 15 * 8 + 100
"""Size of a message of measurements [B]."""
_STEPPED = 50
"""Number of blocks that MuJoCo steps through at a turn."""


@dataclass(frozen=True)
class Turns:
    """Turns of each team, and CPU times of MuJoCo's steps of a block beside them [s]."""

    whole: list[Turn]
    bare: list[Turn]
    zenoh: list[Turn]
    steps: list[float]


def measure(effort: Effort) -> Section:
    """Compare both with Zenoh alone, for each size of team."""
    return _section(_measured(effort))


def _measured(effort: Effort) -> dict[int, dict[str, Figure]]:
    return {robots: figures_of(robots, _of_size(robots, _TURNS[effort])) for robots in SIZES}


def _section(found: dict[int, dict[str, Figure]]) -> Section:
    figures = [figure for each in found.values() for figure in each.values()]
    return Section(name="floor", title="Whole system and bare floor against Zenoh alone", figures=figures)


def _of_size(robots: int, turns: int) -> Turns:
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
                        found.whole.append(real.turn(TURN[robots]))
                        found.bare.append(bare.turn(TURN[robots]))
                        found.zenoh.append(zenoh_alone.turn(TURN[robots]))
                        found.steps.append(steps())
    return found


def _stepper(scenario: Scenario) -> Callable[[], float]:
    """Return a function that measures the CPU time of MuJoCo's steps of a block [s], with the arms at rest."""
    simulation = Simulation(scenario)
    steps = _STEPPED * BLOCK * PHYSICS_RATE // RATE

    def timed() -> float:
        began = time.process_time()
        mujoco.mj_step(simulation.model, simulation.data, nstep=steps)
        return (time.process_time() - began) / _STEPPED

    return timed


def figures_of(robots: int, found: Turns) -> dict[str, Figure]:
    """Return ratios of times per block by their names in the JSON; of the whole team unless of the server."""
    team, is_small = f"N = {robots}", robots == SIZES[0]
    figures = {}
    for key, name, turns, bar in (
        ("whole", "the whole system", found.whole, WHOLE_BAR),
        ("bare", "the bare floor", found.bare, BARE_BAR[robots]),
    ):
        what = f"per block of {name}, against Zenoh alone, {team}"
        wall, cpu = compared("block_time", turns, found.zenoh), compared("team_time", turns, found.zenoh)
        figures[f"{key}_over_zenoh"] = against(f"time {what}", *wall, bar=bar)
        figures[f"{key}_over_zenoh_cpu"] = against(f"CPU time {what}", *cpu, is_guarded=True, of=", all processes")
    figures["server_over_bare_server"] = against(
        f"CPU time of the server per block, against the floor's, {team}",
        *compared("server_time", found.whole, found.bare),
        bar=SERVER_BAR if is_small else None,
        is_guarded=True,
    )
    figures["server_over_steps"] = Figure(
        name=f"CPU time of the server per block, against MuJoCo's steps, {team}",
        value=ratio([turn.server_time for turn in found.whole], found.steps),
        bar=STEPS_BAR if is_small else None,
        note=f"of which a block takes {1e3 * statistics.median(found.steps):.3f} ms",
    )
    figures["agent_over_bare_agent"] = against(
        f"CPU time per agent and block, against the floor's, {team}", *compared("agent_time", found.whole, found.bare)
    )
    return figures


def main(*, effort: Effort = "usual", json: Path | None = None) -> None:
    """Measure, and print the table.

    Args:
        effort: How much to measure.
        json: File for the ratios by number of robots.
    """
    began = time.monotonic()
    found = _measured(effort)
    print("\n".join(section_lines(msgspec.structs.replace(_section(found), seconds=time.monotonic() - began))))
    if json is not None:
        ratios = {str(robots): {key: each.value for key, each in figures.items()} for robots, figures in found.items()}
        json.write_bytes(msgspec.json.format(msgspec.json.encode(ratios)) + b"\n")


if __name__ == "__main__":
    run_command(main, __doc__)

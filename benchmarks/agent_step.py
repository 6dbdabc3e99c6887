"""Costs of a step of a whole agent: CPU time, calls and bytes, per estimator, also against another checkout.

Rings at 1 kHz with 20 samples a block run from their start, without a load change. The physics is computed once; every
estimator gets the same samples, in a separate process, in turns of ten blocks. A whole agent decodes its measurements
and its neighbours' messages, steps, and encodes its reference, its message, and its report if one is due. 'none' is an
agent whose estimator does nothing. With --against PATH, agents of another checkout of coheft, for instance a git
worktree of an older version, alternate with ours on the same samples.

The JSON has a table for each number of robots, which has one for each estimator:

    us_per_block       CPU time per agent and block [µs], over the whole run
    first_valid_us     the same over the blocks after the one in which the last agent knows its poses
    first_valid_s      the end of that block [s]; both are null if there is none
    worst_block_ms     the longest step of any agent [ms]
    calls_per_block    calls of Python functions per agent and block, as counted by cProfile, including resumed
                       generators; counted in a second process, of at most 6 agents, in all blocks
    c_calls_per_block  calls of functions and methods in C from Python, which calls_per_block does not include
    bytes_per_message  mean size of an encoded message to neighbours
    against            the same of the same estimator in the other checkout
    ratio              figures of the other checkout over ours; us_median_of_turns is the median over the turns of the
                       ratio of us_per_block, which depends less on other load
"""

import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from itertools import islice
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from benchmarks import agent_step_team
from benchmarks.agent_step_team import COUNTED, NONE, Took, Turn, ring
from benchmarks.command import run_command
from benchmarks.figures import digits, ratio
from benchmarks.runner import this_machine
from coheft.app.study.samples import reference_blocks
from coheft.consensus.graph import build_graph
from coheft.errors import CoheftError, UsageError
from coheft.estimation.geometry.spatial import Array
from coheft.physics_server.simulation import Simulation
from coheft.wire.scenario.schema import Scenario

HERE = Path(__file__).resolve().parents[1]
"""This checkout."""
_TURN = 10
"""Number of blocks of a turn."""
_TELL_EVERY = 25
"""Number of turns between lines of progress."""
_COMPARED = ("us_per_block", "first_valid_us", "worst_block_ms", "calls_per_block", "bytes_per_message")


class StepFigures(msgspec.Struct, frozen=True, kw_only=True):
    """Costs of a step of an agent; see the module."""

    us_per_block: float
    first_valid_us: float | None
    first_valid_s: float | None
    worst_block_ms: float
    calls_per_block: float
    c_calls_per_block: float
    bytes_per_message: float


def simulated(scenario: Scenario) -> Iterator[Array]:
    """Yield the samples of each block, (robots, B, 15), on reference motions, which do not depend on estimates."""
    simulation = Simulation(scenario, build_graph(scenario.graph, scenario.robot_names))
    for result in reference_blocks(scenario, simulation):
        yield np.array([each.samples for each in result.measurements.values()])


class Process:
    """The process of a team, see ``benchmarks.agent_step_team``."""

    def __init__(self, robots: int, estimator: str, root: Path, is_counting: bool) -> None:
        self.name = estimator if root == HERE else f"{estimator} of {root}"
        self.costs: list[Took] = []
        command = [sys.executable, "-P", agent_step_team.__file__, str(robots), estimator, str(root)]
        path = os.pathsep.join(filter(None, (str(root), os.environ.get("PYTHONPATH"))))
        self._process = subprocess.Popen(
            [*command, "--count"] if is_counting else command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": path},
        )

    def take(self, turn: Turn) -> None:
        """Let the team step through some blocks, and wait until it has; errors as of ``answer``."""
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):  # the process has ended, and will not answer
            self._process.stdin.write(msgspec.json.encode(turn) + b"\n")
            self._process.stdin.flush()
        self.costs.append(msgspec.json.decode(self.answer(), type=Took))

    def answer(self) -> bytes:
        """Wait for the next line of the process, and return it; the first one says that the team is ready.

        It raises a ``CoheftError`` if the process has ended; the reason is on stderr.
        """
        assert self._process.stdout is not None
        if line := self._process.stdout.readline():
            return line
        raise CoheftError(f"the agents with the estimator {self.name} ended: exit status {self._process.wait()}")

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        with self._process:  # closes its pipes, and waits for it
            pass


class Pair:
    """Two teams with the same estimator: one is timed, the calls of the other are counted."""

    def __init__(self, stack: ExitStack, scenario: Scenario, estimator: str, root: Path) -> None:
        self._scenario = scenario
        self.timed, self.counted = (Process(scenario.robot_count, estimator, root, count) for count in (False, True))
        for process in (self.timed, self.counted):
            stack.callback(process.close)

    @property
    def turns(self) -> list[float]:
        """CPU time of each turn [s]."""
        return [sum(cost.seconds) for cost in self.timed.costs]

    def figures(self) -> StepFigures:
        """Return the costs of a step, over all turns so far."""
        robots, costs, counts = self._scenario.robot_count, self.timed.costs, self.counted.costs
        seconds = [each for cost in costs for each in cost.seconds]
        knows_poses = [each for cost in costs for each in cost.knows_poses]
        steps, counted = len(seconds) * robots, len(seconds) * min(COUNTED, robots)
        since = knows_poses.index(True) + 1 if True in knows_poses else len(seconds)
        later = seconds[since:]
        return StepFigures(
            us_per_block=round(1e6 * sum(seconds) / steps, 1),
            first_valid_us=round(1e6 * sum(later) / len(later) / robots, 1) if later else None,
            first_valid_s=round(since * self._scenario.block_duration, 6) if later else None,
            worst_block_ms=round(1e3 * max(cost.worst for cost in costs), 2),
            calls_per_block=round(sum(count.calls for count in counts) / counted, 1),
            c_calls_per_block=round(sum(count.c_calls for count in counts) / counted, 1),
            bytes_per_message=round(sum(cost.sizes for cost in costs) / steps, 1),
        )


def measure(robots: int, estimators: Sequence[str], seconds: float, against: Path | None) -> dict[str, Any]:
    """Measure one team with each estimator, and return its part of the JSON; errors as of ``Process.answer``."""
    scenario = ring(robots)
    samples = simulated(scenario)
    blocks = max(1, round(seconds / scenario.block_duration))
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        path = Path(folder) / "samples.npy"
        pairs = {
            estimator: [
                Pair(stack, scenario, estimator, root)
                for root in ([HERE] if against is None or estimator == NONE else [HERE, against])
            ]
            for estimator in estimators
        }
        every = [pair for each in pairs.values() for pair in each]
        timed, counted = [pair.timed for pair in every], [pair.counted for pair in every]
        for process in (*timed, *counted):
            process.answer()
        for number, first in enumerate(range(0, blocks, _TURN), 1):
            last = min(first + _TURN, blocks)
            np.save(path, list(islice(samples, last - first)))
            for process in (*timed, *counted):
                process.take(Turn(str(path), first))
            timed.reverse()  # so that none is always the first
            if number % _TELL_EVERY == 0 or last == blocks:
                costs = ", ".join(f"{pair.timed.name} {pair.figures().us_per_block:.0f} µs" for pair in every)
                progress = f"{robots} robots, {last * scenario.block_duration:g} of {seconds:g} s"
                print(f"{progress}: {costs} per block", file=sys.stderr, flush=True)
        return {estimator: _as_json(*each) for estimator, each in pairs.items()}


def _as_json(ours: Pair, theirs: Pair | None = None) -> dict[str, Any]:
    result = msgspec.structs.asdict(ours.figures())
    if theirs is None:
        return result
    against = msgspec.structs.asdict(theirs.figures())
    ratios = {name: round(against[name] / result[name], 3) for name in _COMPARED if against[name] and result[name]}
    ratios["us_median_of_turns"] = round(ratio(theirs.turns, ours.turns), 3)
    return result | {"against": against, "ratio": ratios}


def _print_table(results: dict[str, Any]) -> None:
    heads = ("µs", "µs, later", "later: s", "worst ms", "calls", "C calls", "bytes")
    print(f"{'robots':>7}  {'estimator':22}" + "".join(f"{head:>10}" for head in heads))
    for robots, table in results.items():
        for estimator, figures in table.items():
            for name, found in ((estimator, figures), (f"{estimator}, against", figures.get("against"))):
                if found is not None:
                    cells = ("-" if found[key] is None else digits(found[key]) for key in StepFigures.__struct_fields__)
                    print(f"{robots:>7}  {name:22}" + "".join(f"{cell:>10}" for cell in cells))


def main(
    *,
    json: Path | None = None,
    teams: str = "6,24",
    seconds: float = 30.0,
    estimators: str = "efficient",
    against: Path | None = None,
) -> None:
    """Measure all teams, write the JSON after each, and print the table.

    Args:
        json: File for the figures.
        teams: Numbers of robots, separated by commas.
        seconds: Simulated time.
        estimators: Estimators to measure besides 'none', separated by commas.
        against: Another checkout, measured in the same turns.

    Raises:
        CoheftError: There is no such team, estimator or checkout.
    """
    against = None if against is None else against.resolve()
    if against is not None and not (against / "coheft" / "agents" / "process" / "main.py").is_file():
        raise UsageError(f"{against} is no checkout of coheft, or one of a version whose modules were elsewhere")
    sizes = [int(team) if team.isdecimal() else 0 for team in teams.split(",")]
    if min(sizes) < 2 or not 0.0 < seconds < math.inf:
        raise UsageError(f"a team has two robots or more, and runs for some time: found {teams!r} and {seconds:g} s")
    names = [*dict.fromkeys([*filter(None, estimators.split(",")), NONE])]
    load_before = os.getloadavg()[0]
    results: dict[str, Any] = {}
    for robots in sizes:
        results[str(robots)] = measure(robots, names, seconds, against)
        about: dict[str, Any] = {"seconds": seconds, "against": against and str(against)}
        about["machine"] = msgspec.structs.asdict(this_machine(load_before))
        if json is not None:  # after each team, so that no measurement is lost
            json.write_bytes(msgspec.json.format(msgspec.json.encode({"about": about} | results)) + b"\n")
    _print_table(results)


if __name__ == "__main__":
    run_command(main, __doc__)

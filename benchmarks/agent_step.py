"""What a step of a whole agent takes: CPU time, calls and bytes, per estimator, also against another checkout.

    python -m benchmarks.agent_step [--json FILE] [--teams 6,24] [--seconds S] [--estimators NAME,...] [--against PATH]

Rings at 1 kHz, 20 samples a block, run from their start without a load change. Their physics is computed once; every
estimator gets the same samples, in a process of its own, in turns of ten blocks. A whole agent decodes its
measurements and its neighbours' messages, steps, and encodes its reference, its message, and its report if one is due.
'none' is an agent whose estimator does nothing. PATH is another checkout of coheft, for instance a git worktree of an
older version: its agents take their turns beside ours, with the same samples.

The JSON holds a table for each number of robots, and in it one for each estimator:

    us_per_block       CPU time per agent and block [µs], over the whole run
    first_valid_us     the same over the blocks after the one in which the last agent came to know its poses
    first_valid_s      the end of that block [s]; both are null if there was none
    worst_block_ms     the longest step that any agent took [ms]
    calls_per_block    calls per agent and block of functions written in Python, as Python's profiler counts them: each
                       time that a generator goes on is one, too. Counted in a second process, of 6 agents at most,
                       in all blocks
    c_calls_per_block  likewise, of functions and methods written in C that Python calls; not in calls_per_block
    bytes_per_message  mean size of an encoded message to neighbours
    against            the same of the same estimator in the other checkout
    ratio              how many times as much it takes there; us_median_of_turns is the median over the turns of that
                       of us_per_block, which a machine that is busy now and then disturbs less
"""

from __future__ import annotations

import argparse
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from benchmarks import agent_step_team
from benchmarks.agent_step_team import COUNTED, NONE, Took, Turn, ring
from benchmarks.figures import digits
from benchmarks.runner import this_machine
from benchmarks.timing import ratio
from coheft.agents.motion.reference import make_motion
from coheft.consensus.graph import build_graph
from coheft.errors import CoheftError
from coheft.estimation.geometry.spatial import Array
from coheft.physics_server.simulation import Simulation
from coheft.wire.config import agent_config
from coheft.wire.messages.structs import Reference
from coheft.wire.scenario.schema import Scenario

HERE = Path(__file__).resolve().parents[1]
"""The checkout that this is."""
_TURN = 10
"""Blocks that a team steps while the others stand still."""
_TELL_EVERY = 25
"""Turns between lines that tell how far it is."""
_COMPARED = ("us_per_block", "first_valid_us", "worst_block_ms", "calls_per_block", "bytes_per_message")


class StepFigures(msgspec.Struct, frozen=True, kw_only=True):
    """What a step of an agent takes; see this module's docstring."""

    us_per_block: float
    first_valid_us: float | None
    first_valid_s: float | None
    worst_block_ms: float
    calls_per_block: float
    c_calls_per_block: float
    bytes_per_message: float


class Source:
    """The physics: what all robots measure while they move as agents want them to, whatever these estimate."""

    def __init__(self, scenario: Scenario) -> None:
        graph = build_graph(scenario.graph, scenario.robot_names)
        self._simulation = Simulation(scenario, graph)
        self._lookahead = scenario.lookahead
        self._motions = {name: make_motion(agent_config(scenario, name, others)) for name, others in graph.items()}

    def take(self, blocks: int) -> Array:
        """The next blocks, shape (blocks, robots, B, 15)."""
        return np.array([self._block() for _ in range(blocks)])

    def _block(self) -> list[Array]:
        index = self._simulation.block
        references: dict[str, Reference] = {}
        if (answers := index - self._lookahead) >= 0:
            for name, motion in self._motions.items():
                wanted = motion.reference(index)
                references[name] = Reference(
                    robot=name, block=index, answers=answers, motion=wanted, wrench=np.zeros(6)
                )
        measurements = self._simulation.advance(references).measurements
        return [measurements[name].samples for name in self._motions]


class Process:
    """A team's process, see ``benchmarks.agent_step_team``.

    Attributes:
        name: Who it is, in words.
        turns: What each turn took so far.
    """

    def __init__(self, robots: int, estimator: str, root: Path, is_counting: bool) -> None:
        self.name = estimator if root == HERE else f"{estimator} of {root}"
        self.turns: list[Took] = []
        command = [sys.executable, "-P", agent_step_team.__file__, str(robots), estimator, str(root)]
        if is_counting:
            command.append("--count")
        path = os.pathsep.join(filter(None, (str(root), os.environ.get("PYTHONPATH"))))
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env={**os.environ, "PYTHONPATH": path}
        )

    def wait_until_ready(self) -> None:
        """Wait until it has loaded all code and made its agents.

        Raises:
            CoheftError: It has ended; why is on stderr.
        """
        self._answer()

    def take(self, turn: Turn) -> None:
        """Let it step some blocks, and wait until it has.

        Raises:
            CoheftError: It has ended; why is on stderr.
        """
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):  # it has ended, as there is no answer then
            self._process.stdin.write(msgspec.json.encode(turn) + b"\n")
            self._process.stdin.flush()
        self.turns.append(msgspec.json.decode(self._answer(), type=Took))

    def _answer(self) -> bytes:
        """The next line from it.

        Raises:
            CoheftError: It has ended.
        """
        assert self._process.stdout is not None
        if line := self._process.stdout.readline():
            return line
        raise CoheftError(f"the agents with the estimator {self.name} ended: exit status {self._process.wait()}")

    def close(self) -> None:
        """End it."""
        self._process.kill()
        with self._process:  # closes its pipes, and waits for it
            pass


class Pair:
    """Two teams with the same estimator: the steps of one are timed, the calls of the other counted."""

    def __init__(self, stack: ExitStack, scenario: Scenario, estimator: str, root: Path) -> None:
        self._robots = scenario.robot_count
        self._block_duration = scenario.block_duration
        self.timed, self.counted = (Process(self._robots, estimator, root, counting) for counting in (False, True))
        for process in (self.timed, self.counted):
            stack.callback(process.close)

    @property
    def turns(self) -> list[float]:
        """CPU time of each turn [s]."""
        return [sum(took.seconds) for took in self.timed.turns]

    def line(self) -> str:
        """What it has come to so far."""
        return f"{self.timed.name} {self.figures().us_per_block:.0f} µs"

    def figures(self) -> StepFigures:
        """What a step takes, over all turns so far."""
        seconds = [each for took in self.timed.turns for each in took.seconds]
        knows_poses = [each for took in self.timed.turns for each in took.knows_poses]
        steps = len(seconds) * self._robots
        since = knows_poses.index(True) + 1 if True in knows_poses else len(seconds)
        later = seconds[since:]
        counted = len(seconds) * min(COUNTED, self._robots)
        return StepFigures(
            us_per_block=round(1e6 * sum(seconds) / steps, 1),
            first_valid_us=round(1e6 * sum(later) / len(later) / self._robots, 1) if later else None,
            first_valid_s=round(since * self._block_duration, 6) if later else None,
            worst_block_ms=round(1e3 * max(took.worst for took in self.timed.turns), 2),
            calls_per_block=round(sum(took.calls for took in self.counted.turns) / counted, 1),
            c_calls_per_block=round(sum(took.c_calls for took in self.counted.turns) / counted, 1),
            bytes_per_message=round(sum(took.sizes for took in self.timed.turns) / steps, 1),
        )


@contextmanager
def _pairs(scenario: Scenario, estimators: Sequence[str], roots: Sequence[Path]) -> Iterator[dict[str, list[Pair]]]:
    """For each estimator its two teams in each checkout; an agent that does nothing is only one of ours."""
    with ExitStack() as stack:
        yield {
            estimator: [Pair(stack, scenario, estimator, root) for root in (roots[:1] if estimator == NONE else roots)]
            for estimator in estimators
        }


def measure(robots: int, estimators: Sequence[str], seconds: float, against: Path | None) -> dict[str, Any]:
    """One team, with each estimator; what goes into the JSON.

    Args:
        robots: Number of robots.
        estimators: Names.
        seconds: Simulated time [s].
        against: Another checkout.

    Raises:
        CoheftError: An estimator cannot be used, or there is no such team.
    """
    scenario = ring(robots)
    source = Source(scenario)
    blocks = max(1, round(seconds / scenario.block_duration))
    roots = [HERE] if against is None else [HERE, against]
    with tempfile.TemporaryDirectory() as folder, _pairs(scenario, estimators, roots) as pairs:
        path = Path(folder) / "samples.npy"
        both = [pair for each in pairs.values() for pair in each]
        timed, counted = [pair.timed for pair in both], [pair.counted for pair in both]
        for process in (*timed, *counted):
            process.wait_until_ready()
        for number, first in enumerate(range(0, blocks, _TURN), 1):
            last = min(first + _TURN, blocks)
            np.save(path, source.take(last - first))
            for process in (*timed, *counted):
                process.take(Turn(str(path), first))
            timed.reverse()  # none is always the first
            if number % _TELL_EVERY == 0 or last == blocks:
                lines = ", ".join(pair.line() for pair in both)
                print(
                    f"{robots} robots, {last * scenario.block_duration:g} of {seconds:g} s: {lines} per block",
                    file=sys.stderr,
                    flush=True,
                )
        return {estimator: _told(*each) for estimator, each in pairs.items()}


def _told(ours: Pair, theirs: Pair | None = None) -> dict[str, Any]:
    """What the JSON says of an estimator: of ours, and beside it of the other checkout's."""
    told = msgspec.structs.asdict(ours.figures())
    if theirs is None:
        return told
    against = msgspec.structs.asdict(theirs.figures())
    ratios = {name: round(against[name] / told[name], 3) for name in _COMPARED if against[name] and told[name]}
    ratios["us_median_of_turns"] = round(ratio(theirs.turns, ours.turns), 3)
    return told | {"against": against, "ratio": ratios}


def _rows(robots: str, table: dict[str, Any]) -> Iterator[str]:
    """A line of the table on stdout for each estimator in each checkout."""
    for estimator, figures in table.items():
        for name, told in ((estimator, figures), (f"{estimator}, against", figures.get("against"))):
            if told is not None:
                values = ("-" if told[key] is None else digits(told[key]) for key in StepFigures.__struct_fields__)
                yield f"{robots:>7}  {name:22}" + "".join(f"{value:>10}" for value in values)


def main() -> None:
    """Measure all teams, write the JSON anew after each, print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.agent_step",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--json", metavar="FILE", type=Path, help="where to write the figures")
    parser.add_argument("--teams", metavar="N,...", default="6,24", help="numbers of robots")
    parser.add_argument("--seconds", metavar="S", type=float, default=30.0, help="simulated time")
    parser.add_argument(
        "--estimators", metavar="NAME,...", default=ring(6).estimator, help=f"which ones, besides '{NONE}'"
    )
    parser.add_argument("--against", metavar="PATH", type=Path, help="another checkout, measured in the same turns")
    chosen = parser.parse_args()
    against = None if chosen.against is None else chosen.against.resolve()
    if against is not None and not (against / "coheft" / "agents" / "process" / "main.py").is_file():
        parser.error(f"{against} is no checkout of coheft, or one of a version whose modules were elsewhere")
    try:
        teams = [int(team) for team in chosen.teams.split(",")]
    except ValueError:
        parser.error(f"--teams expects numbers with commas between them, not {chosen.teams!r}")
    if min(teams) < 2 or not 0.0 < chosen.seconds < math.inf:
        parser.error("a team has two robots or more, and runs for some time")
    estimators = [*dict.fromkeys([*filter(None, chosen.estimators.split(",")), NONE])]
    load_before = os.getloadavg()[0]
    results: dict[str, Any] = {}
    try:
        for robots in teams:
            results[str(robots)] = measure(robots, estimators, chosen.seconds, against)
            about = {"seconds": chosen.seconds, "against": against and str(against)}
            about["machine"] = msgspec.structs.asdict(this_machine(load_before))
            if chosen.json is not None:  # each time: what was measured is not lost
                data = msgspec.json.format(msgspec.json.encode({"about": about} | results))
                chosen.json.write_bytes(data + b"\n")
    except (CoheftError, OSError) as error:
        sys.exit(f"agent_step: {error}")
    except KeyboardInterrupt:
        sys.exit(130)
    heads = ("µs", "µs, later", "later: s", "worst ms", "calls", "C calls", "bytes")
    print(f"{'robots':>7}  {'estimator':22}" + "".join(f"{head:>10}" for head in heads))
    for team, table in results.items():
        print(*_rows(team, table), sep="\n")


if __name__ == "__main__":
    main()

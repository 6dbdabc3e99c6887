"""Faults of a team of real processes in real time: times until they are noticed, and until all robots are valid again.

All times are measured by an observer's clock: *noticed* from the fault until all affected robots have reported it,
*valid again* from the repair until every robot's estimate is valid.
"""

from __future__ import annotations

import signal
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from benchmarks.command import run_command
from coheft.app.run.plan import Plan
from coheft.wire.messages.requests import StatusRequest
from tests.integration.relay import Relay
from tests.integration.relayed import Edge, with_relays
from tests.integration.team import Team, running_team, small_scenario
from tests.integration.watcher import Watcher, watching

LASTS = 2.0
"""Duration of each fault [s]."""
SETTLES = 2.0
"""Time between a return to validity and the next fault [s]."""
GIVE_UP = 60.0


Notice = tuple[str, str]
"""A robot, and the words with which it reports a fault."""


@dataclass(frozen=True)
class Bench:
    """A team under test, with relays on some of its links; the agent of ``victim`` fails."""

    team: Team
    watcher: Watcher
    relays: dict[Edge, Relay]
    victim: str

    def let_pass(self, until: float) -> None:
        """Listen until a time."""
        while (left := until - time.monotonic()) > 0.0:
            self.watcher.listen(left)

    def silence(self, *edges: Edge) -> list[Notice]:
        """Return the notices of both robots of links that the other is silent."""
        return [pair for one, other in edges for pair in ((one, f"{other} is silent"), (other, f"{one} is silent"))]

    def silent_victim(self) -> list[Notice]:
        """Return the notices of the victim's neighbours that it is silent."""
        return [(other, f"{self.victim} is silent") for other in self.team.plan.agents[self.victim].agent.neighbours]

    def try_fault(self, fault: Fault) -> tuple[float, float]:
        """Apply a fault and repair it; return the times until it was noticed and until all were valid again [s]."""
        began = time.monotonic()
        with fault(self) as expected:

            def times() -> list[float | None]:
                return [self.watcher.is_told(name, words, began) for name, words in expected]

            self.watcher.wait_until(lambda: None not in times(), f"notice: {expected}", GIVE_UP)
            noticed = max(at for at in times() if at is not None) - began
            self.let_pass(began + LASTS)
            ended = time.monotonic()
        after = -1 if fault is server_killed else self.team.ask(StatusRequest()).block
        return noticed, self.watcher.wait_until_valid(after, GIVE_UP) - ended


Fault = Callable[[Bench], AbstractContextManager[list[Notice]]]
"""Causes a fault, yields what robots have to report, and repairs it."""


@contextmanager
def agent_killed(bench: Bench) -> Iterator[list[Notice]]:
    """Kill an agent, and start it again."""
    bench.team.kill(bench.victim)
    yield bench.silent_victim()
    bench.watcher.latest.pop(bench.victim)
    bench.team.restart(bench.victim)
    bench.watcher.wait_until(lambda: bench.victim in bench.watcher.latest, "its first estimate", GIVE_UP)


@contextmanager
def agent_frozen(bench: Bench) -> Iterator[list[Notice]]:
    """Stop an agent for a while."""
    process = bench.team.processes[bench.victim]
    process.send_signal(signal.SIGSTOP)
    yield bench.silent_victim()
    process.send_signal(signal.SIGCONT)


@contextmanager
def link_frozen(bench: Bench) -> Iterator[list[Notice]]:
    """Forward nothing on a link for a while."""
    edge, relay = next(iter(bench.relays.items()))
    relay.freeze()
    yield bench.silence(edge)
    relay.thaw()


@contextmanager
def partition(bench: Bench) -> Iterator[list[Notice]]:
    """Cut both links between the halves of the ring for a while."""
    for relay in bench.relays.values():
        relay.cut()
    yield bench.silence(*bench.relays)
    for relay in bench.relays.values():
        relay.heal()


@contextmanager
def server_killed(bench: Bench) -> Iterator[list[Notice]]:
    """Kill the server, and start it again with a new world."""
    bench.team.kill("server")
    yield [(name, "lost the link with the server") for name in bench.team.plan.agents]
    bench.team.restart("server")
    bench.watcher.wait_until(lambda: not bench.watcher.all_are_valid(), "a new beginning", GIVE_UP)


FAULTS: dict[str, Fault] = {
    "agent killed, started again": agent_killed,
    "agent frozen (SIGSTOP)": agent_frozen,
    "link frozen": link_frozen,
    "partition (two links cut)": partition,
    "server killed, started again": server_killed,
}


@contextmanager
def bench(robots: int, folder: Path) -> Iterator[Bench]:
    """Run a ring in real time, with relays on the two links between its halves."""
    half = robots // 2
    with ExitStack() as stack:
        relays: dict[Edge, Relay] = {}

        def relayed(plan: Plan) -> Plan:
            names = list(plan.agents)
            edges = [(names[0], names[-1]), (names[half - 1], names[half])]
            plan, made = with_relays(plan, edges, stack)
            relays.update(made)
            return plan

        team = stack.enter_context(running_team(small_scenario(robots), folder, "realtime", change=relayed))
        watcher = stack.enter_context(watching(team))
        watcher.wait_until_valid(limit=GIVE_UP)
        yield Bench(team, watcher, relays, victim=list(team.plan.agents)[1])


def main(*, robots: int = 6, repeat: int = 5) -> None:
    """Print the table.

    Args:
        robots: Number of robots.
        repeat: How often each fault is repeated.
    """
    print(f"{robots} robots in a ring, in real time; median and worst of {repeat}\n")
    print(f"{'fault':32}{'noticed, ms':>20}{'valid again, s':>20}")
    with tempfile.TemporaryDirectory() as folder, bench(robots, Path(folder)) as under_test:
        for name, fault in FAULTS.items():
            results = []
            for _ in range(repeat):
                under_test.let_pass(time.monotonic() + SETTLES)
                under_test.watcher.wait_until_valid(limit=GIVE_UP)
                under_test.watcher.heard.clear()
                results.append(under_test.try_fault(fault))
            noticed, valid = ([result[k] for result in results] for k in (0, 1))
            print(
                f"{name:32}{1e3 * statistics.median(noticed):9.0f}, {1e3 * max(noticed):5.0f}"
                f"{statistics.median(valid):17.1f}, {max(valid):.1f}",
                flush=True,
            )
        print(f"\nlargest error of a mass that was called valid: {under_test.watcher.worst:.1f} standard deviations")


if __name__ == "__main__":
    run_command(main, __doc__)

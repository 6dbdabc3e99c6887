"""Faults in a team of real processes, in real time: how soon they are noticed, and when every robot is valid again.

    python -m benchmarks.faults_processes [--robots N] [--repeat N]

Every figure is measured from outside, by an observer's clock: *noticed* from the fault until all robots that it touches
have said so, *valid again* from the repair until every robot's estimate is valid.
"""

from __future__ import annotations

import argparse
import signal
import statistics
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from coheft.app.run.plan import Plan
from coheft.wire.messages.requests import StatusRequest
from tests.integration.relay import Relay
from tests.integration.relayed import Edge, with_relays
from tests.integration.team import Team, running_team, small_scenario
from tests.integration.watcher import Watcher, watching

LASTS = 2.0
"""How long each fault lasts [s]."""
SETTLES = 2.0
"""Time between a return to validity and the next fault [s]."""
GIVE_UP = 60.0


@dataclass(frozen=True)
class Bench:
    """A team under test."""

    team: Team
    watcher: Watcher
    relays: dict[Edge, Relay]

    @property
    def names(self) -> list[str]:
        """Of the robots."""
        return list(self.team.plan.agents)

    def all_noticed(self, whose: Iterable[tuple[str, str]], since: float) -> float:
        """Time until every robot of the pairs has said the words of its pair [s]."""
        pairs = list(whose)

        def times() -> list[float | None]:
            return [self.watcher.is_told(name, words, since) for name, words in pairs]

        self.watcher.wait_until(lambda: None not in times(), f"notice: {pairs}", GIVE_UP)
        return max(at for at in times() if at is not None) - since

    def let_pass(self, until: float) -> None:
        """Listen until a moment."""
        while (left := until - time.monotonic()) > 0.0:
            self.watcher.listen(left)

    def valid_again(self, since: float, *, new_world: bool = False) -> float:
        """Time until every estimate is valid [s]."""
        after = -1 if new_world else self.team.ask(StatusRequest()).block
        return self.watcher.wait_until_valid(after, GIVE_UP) - since


def kill_an_agent(bench: Bench) -> tuple[float, float]:
    """Kill -9; its process is started again later, and the clock runs from then."""
    victim = bench.names[1]
    began = time.monotonic()
    bench.team.kill(victim)
    noticed = bench.all_noticed(_neighbours(bench, victim), began)
    bench.let_pass(began + LASTS)
    bench.watcher.latest.pop(victim)
    restarted = time.monotonic()
    bench.team.restart(victim)
    bench.watcher.wait_until(lambda: victim in bench.watcher.latest, "its first estimate", GIVE_UP)
    return noticed, bench.valid_again(restarted)


def freeze_an_agent(bench: Bench) -> tuple[float, float]:
    """SIGSTOP, then SIGCONT."""
    victim = bench.names[1]
    began = time.monotonic()
    bench.team.processes[victim].send_signal(signal.SIGSTOP)
    noticed = bench.all_noticed(_neighbours(bench, victim), began)
    bench.let_pass(began + LASTS)
    ended = time.monotonic()
    bench.team.processes[victim].send_signal(signal.SIGCONT)
    return noticed, bench.valid_again(ended)


def freeze_a_link(bench: Bench) -> tuple[float, float]:
    """Nothing passes between two robots, though their connection stands."""
    edge, relay = next(iter(bench.relays.items()))
    began = time.monotonic()
    relay.freeze()
    noticed = bench.all_noticed(_both_ends(edge), began)
    bench.let_pass(began + LASTS)
    ended = time.monotonic()
    relay.thaw()
    return noticed, bench.valid_again(ended)


def cut_the_team_in_two(bench: Bench) -> tuple[float, float]:
    """Both links between two halves of a ring are cut, then healed."""
    began = time.monotonic()
    for relay in bench.relays.values():
        relay.cut()
    noticed = bench.all_noticed((pair for edge in bench.relays for pair in _both_ends(edge)), began)
    bench.let_pass(began + LASTS)
    ended = time.monotonic()
    for relay in bench.relays.values():
        relay.heal()
    return noticed, bench.valid_again(ended)


def kill_the_server(bench: Bench) -> tuple[float, float]:
    """Kill -9; a new server begins a new world, of which everything has to be learned anew."""
    began = time.monotonic()
    bench.team.kill("server")
    noticed = bench.all_noticed(((name, "lost the link with the server") for name in bench.names), began)
    bench.let_pass(began + LASTS)
    restarted = time.monotonic()
    bench.team.restart("server")
    bench.watcher.wait_until(lambda: not bench.watcher.all_are_valid(), "a new beginning", GIVE_UP)
    return noticed, bench.valid_again(restarted, new_world=True)


FAULTS: dict[str, Callable[[Bench], tuple[float, float]]] = {
    "agent killed, started again": kill_an_agent,
    "agent frozen (SIGSTOP)": freeze_an_agent,
    "link frozen": freeze_a_link,
    "partition (two links cut)": cut_the_team_in_two,
    "server killed, started again": kill_the_server,
}


def _neighbours(bench: Bench, name: str) -> Iterator[tuple[str, str]]:
    """A robot's neighbours, each with its word that the robot is silent."""
    for other in bench.team.plan.agents[name].agent.neighbours:
        yield other, f"{name} is silent"


def _both_ends(edge: Edge) -> Iterator[tuple[str, str]]:
    yield edge[0], f"{edge[1]} is silent"
    yield edge[1], f"{edge[0]} is silent"


@contextmanager
def bench(robots: int, folder: Path) -> Iterator[Bench]:
    """A ring in real time, with relays on the two links between its halves."""
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
        yield Bench(team, watcher, relays)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=6)
    parser.add_argument("--repeat", type=int, default=5)
    arguments = parser.parse_args()
    print(f"{arguments.robots} robots in a ring, in real time; median and worst of {arguments.repeat}\n")
    print(f"{'fault':32}{'noticed, ms':>20}{'valid again, s':>20}")
    with tempfile.TemporaryDirectory() as folder, bench(arguments.robots, Path(folder)) as under_test:
        for name, fault in FAULTS.items():
            results = []
            for _ in range(arguments.repeat):
                under_test.let_pass(time.monotonic() + SETTLES)
                under_test.watcher.wait_until_valid(limit=GIVE_UP)
                under_test.watcher.heard.clear()
                results.append(fault(under_test))
            noticed, valid = ([result[k] for result in results] for k in (0, 1))
            print(
                f"{name:32}{1e3 * statistics.median(noticed):9.0f}, {1e3 * max(noticed):5.0f}"
                f"{statistics.median(valid):17.1f}, {max(valid):.1f}",
                flush=True,
            )
        print(f"\nlargest error of a mass that was called valid: {under_test.watcher.worst:.1f} standard deviations")


if __name__ == "__main__":
    main()

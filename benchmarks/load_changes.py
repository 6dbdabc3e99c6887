"""Load changes that are noticed, and some that never were: ``ring6`` again and again, all cores, in process.

    python -m benchmarks.load_changes [--hours H] [--runs N] [--changes SHARE,SHARE,...] [--first-seed S] [--jobs J]

First the load stays as it is for so many simulated hours: every notice is a false alarm. Runs last five minutes, at 100
samples per second in blocks of a fifth of a second; 0 hours leave them out. Then a share of it is added at 20 s, in so
many runs per share, at the scenario's own rate: how long until the last robot has noticed?
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence

import msgspec
from rich.console import Console
from rich.progress import track

from coheft.app.run.inprocess import run_in_process
from coheft.app.run.parallel import side_by_side, workers
from coheft.app.study.detection import judge_detection
from coheft.wire.messages.structs import LoadChangeNotice
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import LoadChange, Scenario

Notices = Mapping[str, list[LoadChangeNotice]]

QUIET_RUN = 300.0
QUIET_RATE, QUIET_BLOCK = 100, 20
CHANGE_AT = 20.0
GIVE_UP = 10.0
"""After so long a change has been missed [s]."""


def quiet_scenario(seed: int) -> Scenario:
    """A long run in which nothing happens."""
    scenario = load_scenario("ring6")
    sensors = msgspec.structs.replace(scenario.sensors, rate=QUIET_RATE, block=QUIET_BLOCK)
    return msgspec.structs.replace(scenario, sensors=sensors, duration=QUIET_RUN, load_changes=(), seed=seed)


def change_scenario(seed: int, share: float) -> Scenario:
    """A run in which a share of the load's mass is added where the scenario adds its own load."""
    scenario = load_scenario("ring6")
    shipped = scenario.load_changes[0]
    mass = share * sum(box.mass for box in scenario.payload.boxes)
    change = LoadChange(at=CHANGE_AT, mass=mass, position=shipped.position)
    return msgspec.structs.replace(scenario, duration=CHANGE_AT + GIVE_UP, load_changes=(change,), seed=seed)


def all_notices(scenario: Scenario) -> Notices:
    """What every robot has noticed by the end of a run; one with a change ends when every robot has noticed it."""
    latest: dict[str, list[LoadChangeNotice]] = {}
    for record in run_in_process(scenario):
        latest.update({name: list(estimate.load_changes) for name, estimate in record.estimates.items()})
        if scenario.load_changes and latest and all(map(_is_of_change, latest.values())):
            break
    return latest


def _is_of_change(notices: Sequence[LoadChangeNotice]) -> bool:
    """Whether a robot has noticed something since the change."""
    return any(notice.noticed_at > CHANGE_AT for notice in notices)


def in_parallel(scenarios: Sequence[Scenario], jobs: int | None, what: str) -> list[Notices]:
    """The notices of many runs, with a progress bar."""
    with workers(jobs):
        found = side_by_side(all_notices, ((scenario,) for scenario in scenarios))
        return list(track(found, what, len(scenarios), console=Console(stderr=True)))


def main() -> None:
    """Run it and print what came out."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=10.0)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--changes", default="0.05,0.01")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--jobs", type=int)
    chosen = parser.parse_args()

    quiet_runs = math.ceil(chosen.hours * 3600.0 / QUIET_RUN)
    if quiet_runs > 0:
        scenarios = [quiet_scenario(chosen.first_seed + k) for k in range(quiet_runs)]
        found = judge_detection(in_parallel(scenarios, chosen.jobs, "nothing happens"), None, QUIET_RUN)
        print(f"no change: {found.false_alarms} false alarms in {found.hours:.1f} h")
    else:
        print(f"no change: not measured, for --hours is {chosen.hours:g}")
    for share in map(float, filter(None, chosen.changes.split(","))):
        scenarios = [change_scenario(chosen.first_seed + k, share) for k in range(chosen.runs)]
        notices = in_parallel(scenarios, chosen.jobs, f"{share:.1%} more")
        found = judge_detection(notices, CHANGE_AT, CHANGE_AT)
        mean, most = (f"{value:.2f} s" if value is not None else "-" for value in (found.delay_s, found.delay_max_s))
        print(
            f"{share:.1%} more: noticed by the last robot after {mean} on average, {most} at most, "
            f"missed in {found.missed} of {len(notices)} runs, {found.false_alarms} false alarms before"
        )


if __name__ == "__main__":
    main()

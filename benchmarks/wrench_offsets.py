"""A force or torque sensor that goes off after the start, in many teams: is a wrong load ever called valid?

    python -m benchmarks.wrench_offsets [--schedules N] [--first N] [--jobs J]

A harsher campaign than ``coheft faults``: in every schedule a sensor of a robot's wrench is off by 5 to 100 times its
noise for 0.5 to 3 s, at a time when most teams have just come to know the load; in every other one an agent dies and
comes back around the time when that begins. Offsets that are there before a load is known, or come together with
another one, cannot be told from it: such schedules are counted apart.
"""

from __future__ import annotations

import argparse

import msgspec
import numpy as np
from rich.console import Console
from rich.progress import track

from coheft.app.faults.draw import draw_schedule
from coheft.app.faults.recovery import latest_recovery
from coheft.app.faults.schedule import AnyFault, Crash, FaultSchedule, SensorFault
from coheft.app.faults.trial import Outcome, try_schedule
from coheft.app.run.parallel import side_by_side, workers

SHORTEST = 12.0
"""Run [s]."""
SOON = 1.0
"""What a load is may not be known so soon after it has changed [s]."""
STREAM = 7
"""Of random numbers: other ones than those of the schedules."""
_replace = msgspec.structs.replace


def offset_schedule(number: int) -> FaultSchedule:
    """The team of an even seed, without its own faults, and at most one change of the load."""
    schedule = draw_schedule(2 * number, delayed=False, lasting=False)
    scenario = schedule.scenario
    rng = np.random.default_rng([STREAM, number])
    start = _round(rng.uniform(3.0, 7.0))
    end = _round(start + rng.uniform(0.5, 3.0))
    offset = SensorFault(
        start=start,
        end=end,
        seed=1,
        robot=str(rng.choice(scenario.robot_names)),
        sensor="force" if rng.random() < 0.7 else "torque",
        how="offset",
        size=_round(5.0 * 20.0 ** rng.random()),
    )
    faults: list[AnyFault] = [offset]
    if rng.random() < 0.5:
        dies = _round(start - rng.uniform(0.0, 1.5))
        back = _round(dies + rng.uniform(0.1, 1.0))
        faults.append(Crash(start=dies, end=back, seed=2, robot=str(rng.choice(scenario.robot_names))))
    scenario = _replace(scenario, load_changes=scenario.load_changes[:1])
    schedule = _replace(schedule, scenario=scenario, faults=tuple(faults))
    duration = max(SHORTEST, latest_recovery(schedule) + scenario.block_duration)
    return _replace(schedule, scenario=_replace(scenario, duration=_round(duration)))


def _round(value: float) -> float:
    return round(float(value), 3)


def try_offset(number: int) -> tuple[int, Outcome]:
    """Run it; returns its number, too."""
    return number, try_schedule(offset_schedule(number))


def is_known_before(number: int, outcome: Outcome) -> bool:
    """Whether every robot had been valid before anything happened, and the load stayed as it was meanwhile."""
    schedule = offset_schedule(number)
    offset, first = schedule.faults[0], min(fault.start for fault in schedule.faults)
    changes = [change.at for change in schedule.scenario.load_changes]
    is_alone = not any(first - SOON < at < offset.end for at in changes)
    return is_alone and outcome.first_valid is not None and outcome.first_valid < first


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--schedules", type=int, default=200, metavar="N")
    parser.add_argument("--first", type=int, default=0, metavar="N")
    parser.add_argument("--jobs", type=int, metavar="J")
    options = parser.parse_args()
    console = Console()
    numbers = range(options.first, options.first + options.schedules)
    with workers(options.jobs):
        runs = side_by_side(try_offset, ((number,) for number in numbers))
        tried = sorted(track(runs, "Schedules", len(numbers), console=console), key=lambda each: each[0])
    for is_known, text in ((True, "that knew the load"), (False, "that did not know it yet, or had another one")):
        of_kind = [(number, outcome) for number, outcome in tried if is_known_before(number, outcome) == is_known]
        for promise in ("P1", "P2", "P3"):
            broken = [n for n, outcome in of_kind if any(v.promise == promise for v in outcome.violations)]
            console.print(f"{len(of_kind)} teams {text}: {len(broken)} broke {promise} {broken or ''}")
    recovered = [outcome.recovered for _, outcome in tried if outcome.recovered is not None]
    if recovered:
        median, most = np.percentile(recovered, [50, 95])
        console.print(f"all valid again after {median:.2f} s (median), {most:.2f} s (95 %)")
    console.print(f"loads lost: {sum(bool(outcome.lost) for _, outcome in tried)}")


if __name__ == "__main__":
    main()

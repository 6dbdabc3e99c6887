"""Simplification of a schedule that breaks a promise."""

from collections.abc import Callable, Iterator

import msgspec

from coheft.app.faults.schedule import Crash, FaultSchedule
from coheft.app.faults.trial import Outcome, try_schedule
from coheft.errors import ScenarioError
from coheft.wire.scenario.schema import Graph

_LEAST = 0.1
"""Faults are not made shorter than this [s]."""
_replace = msgspec.structs.replace

Fails = Callable[[FaultSchedule], bool]


def shrink(
    schedule: FaultSchedule, fails: Fails, on_progress: Callable[[FaultSchedule], None] = lambda _: None
) -> FaultSchedule:
    """Return a simpler schedule that still fails, of which no single simplification does.

    Simplifications are tried greedily, the largest first; ``on_progress`` is called with every schedule that is found.
    """
    while True:
        simpler = next((candidate for candidate in _simpler(schedule) if fails(candidate)), None)
        if simpler is None:
            return schedule
        schedule = simpler
        on_progress(schedule)


def breaks_same_promise(outcome: Outcome) -> Fails:
    """Return a function that tells whether a schedule breaks one of the promises that an outcome broke."""
    broken = {violation.promise for violation in outcome.violations}

    def fails(schedule: FaultSchedule) -> bool:
        try:
            return any(violation.promise in broken for violation in try_schedule(schedule).violations)
        except ScenarioError:  # for instance a load change that removes a load that is no longer added
            return False

    return fails


def _simpler(schedule: FaultSchedule) -> Iterator[FaultSchedule]:
    """Yield all single simplifications, from the largest to the smallest."""
    yield from _without_faults(schedule)
    yield from _without_load_changes(schedule)
    yield from _without_differences(schedule)
    yield from _plainer_scenarios(schedule)
    yield from _shorter_runs(schedule)
    yield from _shorter_faults(schedule)


def _without_faults(schedule: FaultSchedule) -> Iterator[FaultSchedule]:
    faults = schedule.faults
    if len(faults) > 1:
        yield _replace(schedule, faults=())
    for k in range(len(faults)):
        yield _replace(schedule, faults=faults[:k] + faults[k + 1 :])


def _without_load_changes(schedule: FaultSchedule) -> Iterator[FaultSchedule]:
    changes = schedule.scenario.load_changes
    # From the last one on, because loads are removed by their numbers.
    for k in reversed(range(len(changes))):
        yield _with_scenario(schedule, load_changes=changes[:k] + changes[k + 1 :])


def _without_differences(schedule: FaultSchedule) -> Iterator[FaultSchedule]:
    """Yield schedules in which no grasp slips, or in which one robot fewer differs from the others."""
    if schedule.scenario.slips:
        yield _with_scenario(schedule, slips=())
    sensors = schedule.scenario.sensors
    for k in range(len(sensors.of)):
        yield _with_scenario(schedule, sensors=_replace(sensors, of=sensors.of[:k] + sensors.of[k + 1 :]))


def _plainer_scenarios(schedule: FaultSchedule) -> Iterator[FaultSchedule]:
    scenario = schedule.scenario
    if scenario.graph != Graph(kind="ring"):
        yield _with_scenario(schedule, graph=Graph(kind="ring"))
    if scenario.lookahead != 1:
        yield _with_scenario(schedule, lookahead=1)
    perimeter = scenario.robots.perimeter
    if perimeter is not None and perimeter.count > 3 and not _names_last_robot(schedule, perimeter.count):
        fewer = _replace(perimeter, count=perimeter.count - 1)
        yield _with_scenario(schedule, robots=_replace(scenario.robots, perimeter=fewer))


def _shorter_runs(schedule: FaultSchedule) -> Iterator[FaultSchedule]:
    scenario, duration = schedule.scenario, schedule.scenario.duration
    latest = max([*(change.at for change in scenario.load_changes), *(slip.at for slip in scenario.slips)], default=0.0)
    for share in (0.5, 0.75, 0.9):
        shorter = round(share * duration, 1)
        if 1.0 <= shorter < duration and latest < shorter:
            yield _with_scenario(schedule, duration=shorter)


def _shorter_faults(schedule: FaultSchedule) -> Iterator[FaultSchedule]:
    """Yield schedules in which one fault lasts half as long."""
    for k, fault in enumerate(schedule.faults):
        if fault.end - fault.start <= 2.0 * _LEAST:
            continue
        middle = round(0.5 * (fault.start + fault.end), 2)
        halves = [_replace(fault, end=middle)]
        if not isinstance(fault, Crash):
            halves.append(_replace(fault, start=middle))
        for half in halves:
            yield _replace(schedule, faults=(*schedule.faults[:k], half, *schedule.faults[k + 1 :]))


def _names_last_robot(schedule: FaultSchedule, count: int) -> bool:
    """Whether a fault concerns the robot with the highest number."""
    last = f'"r{count}"'.encode()
    return any(last in msgspec.json.encode(fault) for fault in schedule.faults)


def _with_scenario(schedule: FaultSchedule, **changes: object) -> FaultSchedule:
    return _replace(schedule, scenario=_replace(schedule.scenario, **changes))

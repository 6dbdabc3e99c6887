"""Simplification of a schedule that breaks a promise."""

from collections.abc import Callable, Collection, Iterator
from typing import TypeVar

import msgspec

from coheft.app.faults.schedule import Crash, FaultSchedule
from coheft.app.faults.trial import try_schedule
from coheft.errors import ScenarioError
from coheft.wire.scenario.schema import Graph

_LEAST = 0.1
"""Faults are not made shorter than this [s]."""
T = TypeVar("T")
_replace = msgspec.structs.replace


def shrink(schedule: FaultSchedule, fails: Callable[[FaultSchedule], bool]) -> Iterator[FaultSchedule]:
    """Yield simpler and simpler schedules that still fail; of the last one no single simplification does.

    Simplifications are tried greedily, the largest first.
    """
    while simpler := next((candidate for candidate in _simpler(schedule) if fails(candidate)), None):
        schedule = simpler
        yield schedule


def breaks(promises: Collection[str], schedule: FaultSchedule) -> bool:
    """Whether a schedule breaks one of these promises."""
    try:
        return any(violation.promise in promises for violation in try_schedule(schedule).violations)
    except ScenarioError:  # for instance a load change that removes a load that is no longer added
        return False


def _simpler(schedule: FaultSchedule) -> Iterator[FaultSchedule]:
    """Yield all single simplifications, from the largest to the smallest."""
    yield from _with_less(schedule)
    yield from _plainer_scenarios(schedule)
    yield from _shorter_runs(schedule)
    yield from _shorter_faults(schedule)


def _with_less(schedule: FaultSchedule) -> Iterator[FaultSchedule]:
    """Yield schedules without a fault, a load change, slips, or what makes a robot differ from the others."""
    scenario, sensors = schedule.scenario, schedule.scenario.sensors
    if len(schedule.faults) > 1:
        yield _replace(schedule, faults=())
    for faults in _without_one(schedule.faults):
        yield _replace(schedule, faults=faults)
    # From the last load change on, because loads are removed by their numbers.
    for changes in reversed(list(_without_one(scenario.load_changes))):
        yield _with_scenario(schedule, load_changes=changes)
    if scenario.slips:
        yield _with_scenario(schedule, slips=())
    for of in _without_one(sensors.of):
        yield _with_scenario(schedule, sensors=_replace(sensors, of=of))


def _without_one(items: tuple[T, ...]) -> Iterator[tuple[T, ...]]:
    return (items[:k] + items[k + 1 :] for k in range(len(items)))


def _plainer_scenarios(schedule: FaultSchedule) -> Iterator[FaultSchedule]:
    scenario = schedule.scenario
    if scenario.graph != Graph(kind="ring"):
        yield _with_scenario(schedule, graph=Graph(kind="ring"))
    if scenario.lookahead != 1:
        yield _with_scenario(schedule, lookahead=1)
    perimeter = scenario.robots.perimeter
    if perimeter is None or perimeter.count <= 3:
        return
    last = f'"r{perimeter.count}"'.encode()
    if not any(last in msgspec.json.encode(fault) for fault in schedule.faults):
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
    for k, fault in enumerate(schedule.faults):
        if fault.end - fault.start <= 2.0 * _LEAST:
            continue
        middle = round(0.5 * (fault.start + fault.end), 2)
        halves = [_replace(fault, end=middle)]
        if not isinstance(fault, Crash):
            halves.append(_replace(fault, start=middle))
        for half in halves:
            yield _replace(schedule, faults=(*schedule.faults[:k], half, *schedule.faults[k + 1 :]))


def _with_scenario(schedule: FaultSchedule, **changes: object) -> FaultSchedule:
    return _replace(schedule, scenario=_replace(schedule.scenario, **changes))

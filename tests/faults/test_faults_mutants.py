"""Deliberate bugs are found, each by a schedule of faults."""

from __future__ import annotations

from functools import cache

import msgspec
import pytest

from coheft.app.faults.draw import draw_schedule
from coheft.app.faults.invariants import Watch
from coheft.app.faults.mutants import MUTANTS, mutated
from coheft.app.faults.run import FaultyRun
from coheft.app.faults.schedule import ClockSkew, FaultSchedule
from coheft.estimation.tolerance import INDUSTRIAL
from tests.efficient import test_guards
from tests.faults.drawn import drawn, plain
from tests.faults.once_broken import DRAWN

_replace = msgspec.structs.replace

_CALM = _replace(plain(14), faults=())
_OFF = drawn(31, LASTING=0.0, UNLIKE=0.0)
_LATE = _replace(
    _OFF,
    scenario=_replace(
        _OFF.scenario,
        load_changes=(),
        duration=8.0,
        sensors=_replace(_OFF.scenario.sensors, tolerance=_replace(INDUSTRIAL, clock=2e-5, wrench_delay=2e-5)),
    ),
    faults=(ClockSkew(start=0.0, end=1.5, seed=0, robot="r2", samples=1),),
)
"""A clock is late, which scales and mountings of sensors explain, if they may be as large as they like."""
_AWAY_ONCE = draw_schedule(1012287590)
_AWAY_ONCE = _replace(_AWAY_ONCE, faults=_AWAY_ONCE.faults[:1])
"""A robot lets go, and is back after a second: small changes of the load meanwhile."""
SHOWN_BY = {
    "half-complete-row": _CALM,
    "wrong-row": _CALM,
    "no-lever-arm": _CALM,
    "wrong-side": plain(1635, delayed=False),
    "no-rival": plain(2254, delayed=False),
    "no-confirmation": plain(883),
    "endless-confirmation": _AWAY_ONCE,
    "rare-fits": draw_schedule(1062000043),
    "without-fresh-change": plain(4220, delayed=False),
    "without-tolerance": _LATE,
    "without-restless": draw_schedule(1026664730),
    "without-outdated": draw_schedule(1012287755),
    "without-doubted": draw_schedule(1012287842),
    "without-first-rows": plain(878, delayed=False),
}
"""A schedule for each mutant."""
WITHIN = {
    "no-confirmation": 0.5,
    "endless-confirmation": 2.4,
    "rare-fits": 0.7,
    "without-tolerance": 1.5,
    "without-restless": 6.4,
    "without-doubted": 3.5,
    "without-first-rows": 1.0,
}
"""How soon after the last fault robots are valid again without the mutant [s], if not after 3 s; no run goes on."""


@pytest.mark.parametrize("mutant", MUTANTS)
def test_a_mutant_leaves_nothing_behind(mutant: str):
    owner, method, _ = MUTANTS[mutant]
    right = getattr(owner, method)
    with mutated(mutant):
        assert getattr(owner, method) is not right
    assert getattr(owner, method) is right


def test_for_every_mutant_there_is_a_test_that_finds_it():
    of_guards = {f"without-{guard.replace('_', '-')}" for guard in test_guards.CASES}
    assert set(MUTANTS) == {*SHOWN_BY, *of_guards}


@pytest.mark.slow
@pytest.mark.parametrize("mutant", SHOWN_BY)
def test_every_deliberate_bug_is_found(mutant: str):
    """By a number that is wrong, or because no robot is ever valid; without the bug neither happens."""
    schedule, within = SHOWN_BY[mutant], WITHIN.get(mutant, 3.0)
    if schedule not in DRAWN.values():  # else ``assert_keeps_all_promises`` says so
        assert not goes_wrong_unmutated(msgspec.json.encode(schedule), within)
    with mutated(mutant):
        assert goes_wrong(schedule, within)


@cache
def goes_wrong_unmutated(encoded: bytes, within: float) -> bool:
    """Schedules of several mutants are run once."""
    return goes_wrong(msgspec.json.decode(encoded, type=FaultSchedule), within)


def goes_wrong(schedule: FaultSchedule, within: float) -> bool:
    run, latest = FaultyRun(schedule), {}
    watch = Watch(schedule, run.scene)
    calm = max([schedule.last_fault_end, 0.0, *(change.at for change in schedule.scenario.load_changes)])
    for block in run:
        watch.check(block)
        latest |= {name: outbox.estimate for name, outbox in block.outboxes.items() if outbox.estimate is not None}
        if watch.violations or block.truth.time > calm + within:
            break
    return bool(watch.violations) or {estimate.status for estimate in latest.values()} != {"valid"}

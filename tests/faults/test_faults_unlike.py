"""Teams whose robots differ, or of which one slips, in campaigns: what is drawn, and what is promised then."""

from __future__ import annotations

import math

import msgspec
import pytest

from coheft.app.faults.draw import draw_schedule
from coheft.app.faults.invariants import GRACE_OF_SLIP, Watch
from coheft.app.faults.recovery import FIND_OUT, Recovery, latest_recovery
from coheft.app.faults.run import FaultyRun
from coheft.app.faults.schedule import FaultSchedule, Release
from coheft.app.faults.shrink import shrink
from coheft.app.faults.unlike import unlike_kinds
from coheft.wire.scenario.checks import check_scenario
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import Slip
from tests.faults.drawn import drawn

DRAWN = [drawn(seed, UNLIKE=1.0) for seed in range(200)]


def test_all_kinds_are_drawn_and_every_schedule_has_one() -> None:
    each = [unlike_kinds(schedule.scenario) for schedule in DRAWN]
    assert all(each)
    assert {kind for kinds in each for kind in kinds} == {
        "robot without gyro",
        "robot without velocity sensor",
        "robot without accelerometer",
        "noisier robot",
        "compliant grasp",
        "slip",
    }


def test_they_are_scenarios_that_can_be() -> None:
    for schedule in DRAWN[:60]:
        check_scenario(schedule.scenario, "drawn")


def test_some_schedules_have_them() -> None:
    assert 40 < sum(bool(unlike_kinds(draw_schedule(seed).scenario)) for seed in range(200)) < 80


def test_everything_else_is_drawn_as_before() -> None:
    for unlike in DRAWN[:50]:
        plain, scenario = drawn(unlike.seed, UNLIKE=0.0), unlike.scenario
        sensors = msgspec.structs.replace(scenario.sensors, of=())
        same = msgspec.structs.replace(scenario, sensors=sensors, slips=(), duration=plain.scenario.duration)
        assert (same, unlike.faults) == (plain.scenario, plain.faults)


def test_slips_are_of_robots_that_hold_and_leave_time_to_recover() -> None:
    slipping = [schedule for schedule in DRAWN if schedule.scenario.slips]
    assert slipping
    for schedule in slipping:
        (slip,) = schedule.scenario.slips
        assert slip.robot not in {fault.robot for fault in schedule.faults if isinstance(fault, Release)}
        assert 0.0099 < math.hypot(*slip.translation) < 0.0401
        assert slip.at > (4.0 if schedule.seed % 2 else 0.0) + 1.99
        if schedule.last_fault_end < schedule.scenario.duration:
            assert schedule.scenario.duration > latest_recovery(schedule) > slip.at


def test_shrinking_leaves_out_what_the_failure_does_not_need() -> None:
    drawn = next(each for each in DRAWN if len(each.scenario.sensors.of) > 1 and each.scenario.slips)
    lacking = drawn.scenario.sensors.of[-1]
    *_, found = shrink(drawn, lambda schedule: lacking in schedule.scenario.sensors.of)
    assert found.scenario.sensors.of == (lacking,)
    assert found.scenario.slips == ()
    *_, slipping = shrink(drawn, lambda schedule: bool(schedule.scenario.slips))
    assert slipping.scenario.sensors.of == ()
    assert slipping.scenario.duration > slipping.scenario.slips[0].at


def slip_at(time: float) -> FaultSchedule:
    """A small one, which takes half a second to show."""
    slip = Slip(at=time, robot="r2", translation=(0.003, -0.004, 0.0))
    scenario = load_scenario("ring3", ["duration=6", "load_changes=[]"])
    return FaultSchedule(seed=1, scenario=msgspec.structs.replace(scenario, slips=(slip,)), faults=())


def test_recovery_counts_from_a_slip_and_allows_for_finding_the_grasp() -> None:
    recovery = Recovery(slip_at(2.0))
    recovery.first_valid = 0.0
    limit, must_find_out = recovery._limit()
    assert limit > FIND_OUT
    assert must_find_out
    assert latest_recovery(slip_at(3.0)) == pytest.approx(latest_recovery(slip_at(2.0)) + 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("grace", [GRACE_OF_SLIP, 0.0])
def test_what_is_published_before_a_slip_can_be_noticed_is_not_judged(
    grace: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    schedule = slip_at(2.0)
    monkeypatch.setattr("coheft.app.faults.invariants.GRACE_OF_SLIP", grace)
    run = FaultyRun(schedule)
    watch = Watch(schedule, run.scene)
    for block in run:
        watch.check(block)
        if block.truth.time > 3.8:
            break
    assert bool(watch.violations) == (grace == 0.0)

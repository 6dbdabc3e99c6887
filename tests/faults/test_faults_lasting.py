"""Small errors that last: what is drawn, what robots are told of it, and how it is counted."""

from __future__ import annotations

import msgspec
import pytest

from coheft.app.faults.draw import draw_schedule
from coheft.app.faults.invariants import Watch
from coheft.app.faults.lasting import is_undeclared, lasting_kinds
from coheft.app.faults.readings import USUAL
from coheft.app.faults.recovery import Recovery, latest_recovery
from coheft.app.faults.schedule import FaultSchedule
from coheft.app.faults.summary import summarise
from coheft.app.faults.trial import try_schedule
from coheft.estimation.tolerance import INDUSTRIAL, SensorTolerance
from coheft.physics_server.sensor_errors import SensorErrors
from coheft.wire.scenario.schema import LoadChange
from tests.faults.drawn import drawn, plain
from tests.faults.test_faults_campaign import OUTCOME
from tests.faults.test_faults_invariants import Team, one, schedule

_replace = msgspec.structs.replace
DRAWN = [drawn(seed, LASTING=1.0, UNLIKE=0.0) for seed in range(300)]
UNDECLARED = [each for each in DRAWN if is_undeclared(each.scenario)]
DECLARED = [each for each in DRAWN if not is_undeclared(each.scenario)]


def test_all_kinds_are_drawn_and_every_other_schedule_has_some() -> None:
    kinds = {kind for each in DRAWN for kind in lasting_kinds(each.scenario)}
    shapes = ("offset", "scale", "mounting", "delay")
    assert kinds == {
        *(f"{word} {shape}" for word in ("declared", "undeclared") for shape in shapes),
        "declared drift",
        "small change of the load",
        "slow leak",
    }
    assert all(lasting_kinds(each.scenario) for each in DRAWN)
    usual = [draw_schedule(seed) for seed in range(300)]
    assert 100 < sum(bool(lasting_kinds(each.scenario)) for each in usual) < 200
    for seed in range(50):
        for each in (plain(seed), drawn(seed, LASTING=0.0, UNLIKE=0.0)):
            kinds = {*lasting_kinds(each.scenario)}
            assert kinds <= {"small change of the load"}  # other changes may be small by chance


def test_what_else_is_drawn_does_not_depend_on_it() -> None:
    for lasting in DRAWN[:50]:
        plain = drawn(lasting.seed, LASTING=0.0, UNLIKE=0.0)
        assert lasting.faults == plain.faults
        assert lasting.scenario.robots == plain.scenario.robots
        count = len(plain.scenario.load_changes)
        assert lasting.scenario.load_changes[:count] == plain.scenario.load_changes
        assert len(lasting.scenario.load_changes) <= count + 1


def test_sensors_are_off_by_some_of_their_noise_and_robots_are_told_that_or_nothing() -> None:
    assert len(UNDECLARED) > 100
    assert len(DECLARED) > 100
    for each in DRAWN:
        sensors, noise = each.scenario.sensors, each.scenario.noise
        before = drawn(each.seed, LASTING=0.0, UNLIKE=0.0).scenario.sensors.tolerance
        assert before in (SensorTolerance(), INDUSTRIAL)
        if is_undeclared(each.scenario):
            assert sensors.tolerance == before
            assert not sensors.drift.is_any
        else:
            assert sensors.errors == "drawn"
        for sensor, usual in USUAL.items():
            for key, unit in ((f"{sensor}_offset", 1.0), (f"{sensor}_scale", usual)):
                more = getattr(each.scenario.sensor_errors, key) ** 2 - getattr(before, key) ** 2
                if more > 1e-12:
                    assert 0.29 < more**0.5 * unit / getattr(noise, sensor) < 3.0 * 3**0.5 + 0.01


def test_sensors_are_really_off_whether_or_not_robots_are_told() -> None:
    for each in (UNDECLARED[0], DECLARED[0]):
        exact = _replace(each.scenario, sensors=_replace(each.scenario.sensors, errors="none"))
        drawn, none = (SensorErrors.drawn(s, each.scenario.robot_count) for s in (each.scenario, exact))
        is_off = any((getattr(drawn, name) != getattr(none, name)).any() for name in ("offsets", "matrices", "delays"))
        assert is_off or each.scenario.sensors.drift.is_any


def test_small_changes_come_last_and_runs_go_on_until_nothing_leaks_any_more() -> None:
    plain = {seed: drawn(seed, LASTING=0.0, UNLIKE=0.0).scenario.load_changes for seed in range(300)}
    small = [each for each in DRAWN if len(each.scenario.load_changes) > len(plain[each.seed])]
    assert len(small) > 50
    for each in small:
        *others, last = each.scenario.load_changes
        assert last.mass is not None
        assert 0.0009 < last.mass / each.scenario.payload.inertia().mass < 0.0501
        assert all(change.at < last.at for change in others)
        end = last.at + (last.mass / last.leak if last.leak else 0.0)
        assert end <= last.at + 8.1
        if each.last_fault_end < each.scenario.duration:  # else an agent never comes back
            assert latest_recovery(each) >= end
            assert each.scenario.duration >= latest_recovery(each) - 1e-6


def test_a_load_that_leaks_is_over_when_nothing_is_left() -> None:
    run = schedule(changes=(LoadChange(at=1.0, mass=0.2, leak=0.1, position=(0.0, 0.0, 0.1)),))
    team = Team(run)
    recovery = Recovery(run)
    for block in range(60):
        recovery.add(team.block(block, *(team.estimate(block, name) for name in team.scene.robots)))
        assert recovery.is_steady == (block >= 54)  # from 3.0 s on for 2.5 s


def test_it_is_counted_how_long_a_robot_calls_valid_what_is_off() -> None:
    run = schedule()
    team = Team(run)

    def off_for(*sizes: float | None) -> float | None:
        """Of a robot that publishes estimates that are off by so much, None: stale."""
        watch = Watch(run, team.scene)
        for block, size in enumerate(sizes):
            status = "stale" if size is None else "valid"
            watch.check(team.block(block, team.estimate(block, off=one(0, size or 0.0), status=status)))
        return None if watch.off_for is None else round(watch.off_for, 6)

    assert off_for(0.0, 4.0, 0.0) is None
    assert off_for(0.0, 6.0, 0.0) == 0.0
    assert off_for(6.0, 6.0, 6.0, None, 6.0, 6.0) == 0.2
    assert off_for(0.0, 6.0, 0.0, 6.0, 6.0) == 0.1
    assert off_for(None, None) is None


def test_what_robots_are_not_told_of_breaks_no_promise_but_is_counted() -> None:
    run = plain(14)
    errors = SensorTolerance(force_offset=20.0)
    sensors = _replace(run.scenario.sensors, errors=errors)
    off: FaultSchedule = _replace(run, faults=(), scenario=_replace(run.scenario, duration=4.0, sensors=sensors))
    outcome = try_schedule(off)
    assert outcome.undeclared
    assert outcome.violations == []
    assert outcome.faults == ("undeclared offset",)
    assert outcome.simulated == pytest.approx(4.0, abs=0.1)


def test_a_summary_tells_how_often_and_for_how_long_what_was_off_was_called_valid() -> None:
    outcomes = [
        _replace(OUTCOME, seed=seed, violations=[], faults=("undeclared scale",), undeclared=True, off_for=off)
        for seed, off in enumerate([None, 0.0, 0.9, 1.1])
    ]
    summary = summarise([*outcomes, OUTCOME])
    assert summary.undeclared == (4, 3, 1)
    assert {kind.kind: kind.off for kind in summary.kinds}["undeclared scale"] == (3, 1)

"""Schedules: drawn from seeds, written and read, simplified."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import msgspec
import pytest

from coheft.app.faults.draw import DELAY, LATEST_START, MOST_FAULTS, draw_schedule
from coheft.app.faults.schedule import (
    AnyFault,
    ClockSkew,
    Crash,
    FaultSchedule,
    Loss,
    Partition,
    read_schedule,
    write_schedule,
)
from coheft.app.faults.shrink import shrink
from coheft.errors import ScenarioError
from coheft.wire.scenario.checks import check_scenario
from coheft.wire.scenario.schema import Graph, LoadChange

DRAWN = [draw_schedule(seed) for seed in range(400)]


def test_equal_seeds_draw_equal_schedules_and_others_others():
    assert [draw_schedule(seed) for seed in range(20)] == DRAWN[:20]
    assert len({msgspec.json.encode(schedule) for schedule in DRAWN}) == len(DRAWN)


def test_all_scenarios_are_scenarios_and_long_enough_to_see_all_robots_recover():
    for schedule in DRAWN:
        check_scenario(schedule.scenario, f"seed {schedule.seed}")
        for fault in schedule.faults:
            delay = DELAY * (schedule.seed % 2)
            assert delay <= fault.start <= LATEST_START + delay
            assert fault.start < fault.end <= schedule.scenario.duration
            lasts_for_ever = fault.end == schedule.scenario.duration
            assert fault.end <= schedule.scenario.duration - 4.5 or (lasts_for_ever and isinstance(fault, Crash))


def test_every_kind_of_fault_number_of_faults_team_and_graph_is_drawn():
    kinds = Counter(fault.kind for schedule in DRAWN for fault in schedule.faults)
    assert set(kinds) == {
        "delay",
        "loss",
        "duplication",
        "reordering",
        "corruption",
        "corruption before the checksum",
        "replay (had before)",
        "replay (former incarnation)",
        "replay (other run)",
        "malformed",
        "partition",
        "crash",
        "pause",
        "release",
        "clock skew",
        *(f"sensor {how}" for how in ("nan", "frozen", "outliers", "saturation", "offset")),
        *(f"lie ({how})" for how in ("scaled", "offset", "garbage")),
    }
    assert {len(schedule.faults) for schedule in DRAWN} == set(range(MOST_FAULTS + 1))
    assert {schedule.scenario.robot_count for schedule in DRAWN} == {3, 4, 5, 6}
    assert len({schedule.scenario.graph.kind for schedule in DRAWN}) == 5
    assert {len(schedule.scenario.load_changes) for schedule in DRAWN} == {0, 1, 2, 3}


def test_schedules_are_written_and_read(tmp_path: Path):
    for schedule in DRAWN[:50]:
        write_schedule(schedule, tmp_path / "schedule.json")
        assert read_schedule(tmp_path / "schedule.json") == schedule


def test_what_is_no_schedule_is_refused_with_its_name(tmp_path: Path):
    (tmp_path / "other.json").write_text('{"seed": 1}')
    with pytest.raises(ScenarioError, match=r"other\.json: not a fault schedule"):
        read_schedule(tmp_path / "other.json")
    late = ClockSkew(start=0.0, end=1.0, robot="r1", samples=10**9)
    write_schedule(msgspec.structs.replace(DRAWN[0], faults=(late,)), tmp_path / "other.json")
    with pytest.raises(ScenarioError, match=r"not a fault schedule: Expected `int` <= 100000 - at .*samples"):
        read_schedule(tmp_path / "other.json")


THREE = next(schedule for schedule in DRAWN if schedule.scenario.robot_count == 3)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (Crash(start=1.0, end=2.0, robot="r4"), r"faults\[1\]\.robot': found 'r4', expected one of: r1, r2, r3$"),
        (Crash(start=1.0, end=2.0, robot="*"), r"faults\[1\]\.robot': found '\*', expected one of: r1, r2, r3$"),
        (
            Crash(start=2.0, end=2.0, robot="r1"),
            r"faults\[1\]\.end': found 2 s, expected a time after 'start', .* 2 s$",
        ),
        (Crash(start=900.0, end=901.0, robot="r1"), r"start': found 900 s, expected a time before the end of the run"),
        (Loss(start=1.0, end=2.0, probability=0.5, sender="r9"), r"sender': found 'r9', .*: r1, r2, r3, \*$"),
        (Loss(start=1.0, end=2.0, probability=0.5, receiver="r"), r"receiver': found 'r', .*: r1, r2, r3, \*$"),
        (Partition(start=1.0, end=2.0, group=("r1", "r8")), r"group': found 'r8', expected one of: r1, r2, r3$"),
    ],
)
def test_faults_of_no_robot_or_of_no_time_are_refused(fault: AnyFault, words: str, tmp_path: Path):
    fine = Loss(start=0.0, end=4.0, probability=0.5, receiver="r2")
    write_schedule(msgspec.structs.replace(THREE, faults=(fine, fault)), tmp_path / "by_hand.json")
    with pytest.raises(ScenarioError, match=r"by_hand\.json: key .*" + words):
        read_schedule(tmp_path / "by_hand.json")


def test_scenarios_that_contradict_themselves_are_refused(tmp_path: Path):
    scenario = msgspec.structs.replace(THREE.scenario, load_changes=(LoadChange(at=1.0, remove=1),))
    write_schedule(msgspec.structs.replace(THREE, scenario=scenario), tmp_path / "by_hand.json")
    with pytest.raises(ScenarioError, match=r"by_hand\.json: scenario: key 'load_changes\[0\]\.remove': found 1 "):
        read_schedule(tmp_path / "by_hand.json")


def test_shrinking_leaves_only_what_the_failure_needs():
    """A failure that takes two of four faults at the same time, on any graph."""

    def fails(schedule: FaultSchedule) -> bool:
        crashes = [fault for fault in schedule.faults if isinstance(fault, Crash) and fault.robot == "r1"]
        losses = [fault for fault in schedule.faults if isinstance(fault, Loss)]
        return any(loss.is_active(crash.start) for crash in crashes for loss in losses)

    faults = (
        Crash(start=0.5, end=1.0, robot="r2"),
        Loss(start=0.0, end=4.0, probability=0.5),
        Crash(start=1.0, end=3.0, robot="r1"),
        Loss(start=2.0, end=4.0, probability=0.1, sender="r2"),
    )
    drawn = next(s for s in DRAWN if s.scenario.robot_count == 6 and s.scenario.load_changes)
    *_, found = shrink(msgspec.structs.replace(drawn, faults=faults), fails)
    assert {fault.kind for fault in found.faults} == {"crash", "loss"}
    assert len(found.faults) == 2
    assert fails(found)
    assert found.scenario.load_changes == ()
    assert found.scenario.graph == Graph(kind="ring")
    assert found.scenario.robot_count == 3
    assert found.scenario.duration < 2.0
    assert all(fault.end - fault.start <= 0.3 for fault in found.faults)


def test_values_that_are_set_are_not_drawn():
    for seed in range(20):
        drawn, chosen = draw_schedule(seed), draw_schedule(seed, values=["sensors.rate=200", "motion.rotation=0.25"])
        assert (chosen.scenario.sensors.rate, chosen.scenario.motion.rotation) == (200, 0.25)
        assert chosen.faults == drawn.faults
        assert chosen.scenario.robots == drawn.scenario.robots
        assert draw_schedule(seed, values=["sensors.rate=100"]) == drawn

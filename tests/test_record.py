"""What an observer keeps: the same whatever comes first, and no more after hours than after minutes."""

from __future__ import annotations

import tracemalloc

import msgspec
import numpy as np
import pytest

from coheft.app.results.judge import Verdict
from coheft.app.results.record import SILENT, EstimatorUse, Record
from coheft.app.run.pairing import REMEMBERED
from coheft.app.terminal.final_table import sentences
from coheft.wire.messages.structs import LoadChangeNotice, SlipNotice
from coheft.wire.messages.truth import SlippedGrasp
from tests.synthetic_run import (
    BLOCK,
    HEAVY,
    LIGHT,
    ROBOTS,
    SCENE,
    built_report,
    changing_run,
    estimate,
    recorded,
    truth,
)


def test_the_order_of_arrival_does_not_matter() -> None:
    truths, estimates = changing_run({"r1": 110, "r2": 120, "r3": 115}, {"r1": 2.06, "r2": 2.04, "r3": 2.1})
    truths_first, estimates_first = (Record(SCENE, duration=4.0, with_history=True) for _ in range(2))
    for each in truths:
        truths_first.receive(each)
    for record in (truths_first, estimates_first):
        for name in reversed(ROBOTS):
            for belief in estimates[name]:
                record.receive(belief)
    for each in truths:
        estimates_first.receive(each)
    expected = built_report(recorded(truths, estimates, with_history=True))
    assert expected.load_changes[0].detected_at_s == pytest.approx(2.1)
    assert built_report(truths_first) == expected
    assert built_report(estimates_first) == expected


def test_a_record_is_complete_when_all_robots_have_spoken_of_the_newest_block() -> None:
    record = Record(SCENE, duration=1.0)
    assert not record.complete
    record.receive(truth(0, LIGHT))
    record.receive(truth(1, LIGHT))
    record.receive(estimate("r1", 1, LIGHT))
    record.receive(estimate("r2", 0, LIGHT))
    assert record.silent == ["r3"]
    record.receive(estimate("r3", 1, LIGHT))
    assert not record.complete
    record.receive(estimate("r2", 1, LIGHT))
    assert record.complete
    assert record.silent == []


def test_estimates_of_a_block_whose_truth_has_not_come_wait() -> None:
    record = Record(SCENE, duration=1.0)
    record.receive(truth(0, LIGHT))
    record.receive(estimate("r1", 7, HEAVY))
    assert record.latest["r1"].block == 7
    assert "r1" in record.silent
    record.receive(truth(7, HEAVY))
    report = record.robots["r1"].report
    assert report is not None
    assert report.mass.error_pct == pytest.approx(0.0, abs=1e-9)


def test_estimators_change_once_though_what_was_said_before_comes_later() -> None:
    record = Record(SCENE, duration=1.0)
    said = [
        ("r1", 4, "fan2017"),
        ("r1", 7, "efficient"),
        ("r2", 6, "fan2017"),
        ("r2", 7, "efficient"),
        ("r3", 5, "fan2017"),
    ]
    for block in range(10):
        record.receive(truth(block, LIGHT))
    for name, block, estimator in said:
        record.receive(msgspec.structs.replace(estimate(name, block, LIGHT), estimator=estimator))
    assert record.estimators == [EstimatorUse(4 * BLOCK, "fan2017"), EstimatorUse(7 * BLOCK, "efficient")]
    report = built_report(record)
    assert report.estimator_changes == record.estimators[1:]
    assert "At 0.14 s all robots restarted with the estimator efficient." in sentences(report)


def test_with_another_estimator_robots_have_to_converge_anew() -> None:
    record = Record(SCENE, duration=1.0)
    said = [("fan2017", False), ("fan2017", True), ("efficient", False), ("efficient", False), ("efficient", True)]
    found = []
    for block, (estimator, is_converged) in enumerate(said):
        record.receive(truth(block, LIGHT))
        belief = estimate("r1", block, LIGHT, converged=is_converged)
        record.receive(msgspec.structs.replace(belief, estimator=estimator))
        report = record.robots["r1"].report
        assert report is not None
        found.append(report.converged_at_s)
    assert found == [None, pytest.approx(2 * BLOCK), None, None, pytest.approx(5 * BLOCK)]


def test_who_falls_silent_is_stale() -> None:
    record = Record(SCENE, duration=10.0)
    for block in range(300):
        record.receive(truth(block, LIGHT))
        for name in ROBOTS:
            if name != "r2" or block <= 150:
                record.receive(estimate(name, block, LIGHT))
        is_silent = block > 150 + SILENT
        assert [name for name, belief in record.beliefs.items() if belief.status == "stale"] == ["r2"] * is_silent
    report = built_report(record)
    assert report.robots["r2"].reasons == ["no estimate of r2 since 3.02 s"]
    assert report.robots["r2"].converged
    assert report.verdict is Verdict.NOT_CONVERGED


@pytest.mark.slow
def test_memory_does_not_grow_with_time() -> None:
    """Robots that answer late, and one whose link breaks after a while."""
    record = Record(SCENE, duration=1e6)
    change = LoadChangeNotice(noticed_at=5.1, changed_at=4.9)

    def run(start: int, count: int) -> None:
        for block in range(start, start + count):
            record.receive(truth(block, LIGHT if block < 250 else HEAVY))
            for name in ROBOTS:
                if block % 5 == 4 and block > 10 and not (name == "r3" and block > 3000):
                    record.receive(estimate(name, block - 3, HEAVY, changes=[change]))

    run(0, 3 * REMEMBERED)
    tracemalloc.start()
    run(3 * REMEMBERED, 2 * REMEMBERED)  # what is replaced from now on is counted
    before, _ = tracemalloc.get_traced_memory()
    run(5 * REMEMBERED, 3 * REMEMBERED)
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert before > 1_000_000, "the newest truths are there"
    assert after < 1.02 * before
    (period,) = record.periods[1:]
    assert period.noticed == dict.fromkeys(ROBOTS, 5.1)
    assert np.isclose(record.time, 8 * REMEMBERED * BLOCK)


def test_a_change_is_dated_rightly_by_who_missed_it() -> None:
    """An observer that was stopped for a while hears of it later."""
    record = Record(SCENE, duration=4.0)
    record.receive(truth(49, LIGHT))
    changed_at = 60 * BLOCK
    record.receive(msgspec.structs.replace(truth(99, HEAVY), loads_since=changed_at))
    notice = LoadChangeNotice(noticed_at=changed_at + BLOCK, changed_at=changed_at)
    for name in ROBOTS:
        record.receive(estimate(name, 99, HEAVY, changes=[notice]))
    (change,) = built_report(record).load_changes
    assert change.at_s == pytest.approx(changed_at)
    assert change.detected_at_s == pytest.approx(changed_at + BLOCK)


def test_a_slip_is_told_with_when_the_last_robot_had_named_it() -> None:
    record = Record(SCENE, duration=1.0)
    grasp = SlippedGrasp(SCENE.rotations[1], SCENE.translations[1] + np.array([0.003, 0.0, 0.004]))
    for block in range(10):
        slipped = {"r2": grasp} if block >= 5 else {}
        record.receive(msgspec.structs.replace(truth(block, LIGHT), slipped=slipped))
    named = {"r1": 0.14, "r2": 0.16, "r3": 0.15}
    for name, moment in named.items():
        slips = [SlipNotice("r2", 0.12, moment, 0.1)]
        record.receive(msgspec.structs.replace(estimate(name, 9, LIGHT), slips=slips))
    report = built_report(record)
    (slip,) = report.slips
    assert (slip.at_s, slip.robot, slip.named_at_s) == (pytest.approx(5 * BLOCK), "r2", 0.16)
    assert slip.translation_mm == pytest.approx(5.0)
    assert "At 0.1 s the grasp of r2 slipped by 5.0 mm and 0.0°. All robots had found that after 0.1 s." in sentences(
        report
    )
    record.receive(estimate("r3", 9, LIGHT))
    assert built_report(record).slips[0].named_at_s is None

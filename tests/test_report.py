"""The report against runs whose outcome is known by construction."""

from __future__ import annotations

import json

import msgspec
import numpy as np
import pytest

from coheft.app.results.judge import Verdict
from coheft.estimation.geometry.spatial import Pose, rotation_exp
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.wire.messages.truth import Truth
from tests.synthetic_run import (
    BLOCK,
    GRASPS,
    HEAVY,
    LIGHT,
    LOAD,
    ROBOTS,
    SCENE,
    built_report,
    changing_run,
    estimate,
    recorded,
    truth,
)


def test_a_perfect_run_has_no_errors() -> None:
    truths = [truth(block, LIGHT) for block in range(100)]
    report = built_report(recorded(truths, {r: [estimate(r, b, LIGHT) for b in range(100)] for r in ROBOTS}))
    for robot in report.robots.values():
        assert robot.mass.error_pct == pytest.approx(0.0, abs=1e-9)
        assert robot.com.error_mm == pytest.approx(0.0, abs=1e-9)
        assert robot.inertia.error_pct == pytest.approx(0.0, abs=1e-9)
        assert all(pose.rotation_error_deg < 1e-5 for pose in robot.poses.values())
        assert all(pose.translation_error_mm < 1e-9 for pose in robot.poses.values())
    assert report.consensus.force_rel_error == pytest.approx(0.0, abs=1e-12)
    assert report.consensus.torque_rel_error == pytest.approx(0.0, abs=1e-12)
    assert report.load_changes == []
    assert report.verdict is Verdict.CONVERGED


def test_errors_are_measured_in_the_robots_own_frame() -> None:
    wrong = Inertia(10.5, LIGHT.com + [0.003, 0.0, 0.004], 1.1 * LIGHT.tensor)
    turned = Pose(rotation_exp([0.01, 0.0, 0.0]), np.zeros(3))
    shifted = Pose(turned.rotation, np.array([0.0, 0.002, 0.0]))
    last = {r: [estimate(r, 99, wrong, wrench_error=0.05, pose_error=shifted)] for r in ROBOTS}
    report = built_report(recorded([truth(block, LIGHT) for block in range(100)], last))
    for name, robot in report.robots.items():
        assert robot.mass.error_pct == pytest.approx(5.0)
        assert robot.com.error_mm == pytest.approx(5.0)
        assert robot.inertia.error_pct == pytest.approx(10.0)
        assert set(robot.poses) == set(SCENE.neighbours[name])
        for pose in robot.poses.values():
            assert pose.rotation_error_deg == pytest.approx(np.degrees(0.01))
            assert pose.translation_error_mm == pytest.approx(2.0)
        assert robot.mass.std == pytest.approx(0.1)
        assert robot.com.std == pytest.approx([0.001, 0.002, 0.003])
        assert robot.inertia.std is not None
        assert robot.inertia.std[0] == pytest.approx([0.01, 0.04, 0.05])
        carried = LIGHT.transported(GRASPS[name].inverse())
        assert robot.com.truth == pytest.approx(carried.com)
        assert np.allclose(robot.inertia.truth, carried.tensor)
    assert report.consensus.force_rel_error == pytest.approx(0.05)
    assert report.consensus.torque_rel_error == pytest.approx(0.05)


def test_a_load_change_is_reported_with_the_state_before_it() -> None:
    truths, estimates = changing_run({"r1": 110, "r2": 120, "r3": 115}, {"r1": 2.06, "r2": 2.04, "r3": 2.1})
    (change,) = built_report(recorded(truths, estimates)).load_changes
    assert change.at_s == pytest.approx(2.0)
    assert change.truth.mass == pytest.approx(13.0)
    assert change.detected_at_s == pytest.approx(2.1), "the last robot counts"
    assert change.recovered_at_s == pytest.approx(121 * BLOCK), "the last robot counts"
    for robot in change.before_change.values():
        assert robot.time_s == pytest.approx(2.0)
        assert robot.mass.truth == pytest.approx(10.0)
        assert robot.mass.error_pct == pytest.approx(0.0, abs=1e-9)


def test_what_a_robot_missed_is_none() -> None:
    truths, estimates = changing_run({"r1": 110, "r2": 10**6, "r3": 115}, {"r1": 2.06, "r2": 2.04})
    (change,) = built_report(recorded(truths, estimates)).load_changes
    assert change.detected_at_s is None
    assert change.recovered_at_s is None


def test_recovery_counts_from_when_it_lasts() -> None:
    truths, estimates = changing_run(dict.fromkeys(ROBOTS, 110), {})
    estimates["r3"][150] = estimate("r3", 150, LIGHT)
    (change,) = built_report(recorded(truths, estimates)).load_changes
    assert change.recovered_at_s == pytest.approx(152 * BLOCK)


def test_a_recovery_that_has_lasted_stays_whatever_happens_then() -> None:
    truths, estimates = changing_run(dict.fromkeys(ROBOTS, 110), {})
    estimates["r3"][170:180] = [estimate("r3", block, LIGHT) for block in range(170, 180)]
    (change,) = built_report(recorded(truths, estimates)).load_changes
    assert change.recovered_at_s == pytest.approx(111 * BLOCK)


def test_who_begins_anew_does_not_relapse() -> None:
    """An agent is started again; and all change their estimator, one before it has recovered."""
    truths, estimates = changing_run({"r1": 110, "r2": 130, "r3": 110}, {})
    estimates["r3"][115:125] = [estimate("r3", block, None if block < 120 else LIGHT) for block in range(115, 125)]
    (change,) = built_report(recorded(truths, estimates)).load_changes
    assert change.recovered_at_s == pytest.approx(131 * BLOCK)
    for name, series in estimates.items():
        series[120:140] = [
            msgspec.structs.replace(estimate(name, block, LIGHT), estimator="fan2017") for block in range(120, 140)
        ]
    (change,) = built_report(recorded(truths, estimates)).load_changes
    assert change.recovered_at_s == pytest.approx(141 * BLOCK), "r2 had not recovered before"


def test_a_leak_is_one_change_and_each_estimate_is_compared_with_the_payload_of_its_block() -> None:
    def payload(block: int) -> Inertia:
        return LIGHT if block < 100 else Inertia(13.0 - 0.02 * (block - 100), HEAVY.com, HEAVY.tensor)

    def leaking(block: int) -> Truth:
        load = msgspec.structs.replace(LOAD, mass=payload(block).mass - 10.0, leak=1.0)
        return msgspec.structs.replace(truth(block, payload(block)), loads=[load] if block >= 100 else [])

    truths = [leaking(block) for block in range(200)]
    estimates = {r: [estimate(r, b, LIGHT if b < 110 else payload(b)) for b in range(200)] for r in ROBOTS}
    report = built_report(recorded(truths, estimates, with_history=True))
    (change,) = report.load_changes
    assert change.at_s == pytest.approx(2.0)
    assert change.truth.mass == pytest.approx(13.0)
    assert change.leak_kg_s == pytest.approx(1.0)
    assert change.recovered_at_s == pytest.approx(111 * BLOCK)
    assert report.history is not None
    for name in ROBOTS:
        assert [point.mass_error_pct for point in report.history[name]] == pytest.approx([0.0] * 4, abs=1e-9)
        assert report.robots[name].mass.truth == pytest.approx(11.02)


def test_nothing_observable_gives_no_numbers() -> None:
    truths = [truth(block, LIGHT) for block in range(10)]
    report = built_report(recorded(truths, {r: [estimate(r, 9, None, converged=False)] for r in ROBOTS}))
    assert report.verdict is Verdict.NOT_CONVERGED
    for robot in report.robots.values():
        assert robot.not_observable == ["mass: too little motion"]
        assert robot.mass.estimate is robot.com.estimate is robot.inertia.estimate is None
        assert robot.mass.truth == pytest.approx(10.0)
        assert robot.converged_at_s is None


def test_poses_that_are_still_being_found_are_not_reported() -> None:
    last = {r: [estimate(r, 9, None, converged=False, phase="poses")] for r in ROBOTS}
    report = built_report(recorded([truth(block, LIGHT) for block in range(10)], last))
    assert all(robot.poses == {} for robot in report.robots.values())
    assert report.consensus.force_rel_error is None


def test_speed_counts_every_message_of_a_block() -> None:
    truths = [truth(block, LIGHT) for block in range(100)]
    estimates = {r: [estimate(r, block, LIGHT) for block in range(4, 100, 5)] for r in ROBOTS}
    report = built_report(recorded(truths, estimates))
    assert report.real_time_factor == pytest.approx(1.0)
    assert report.processes == 4
    per_block = 3 + 3 + 4 + 3 / 5 + 1  # measurements, references, two edges both ways, estimates, truth
    assert report.messages_per_s == pytest.approx(per_block * 100 / 2.0)


def test_history_has_a_point_for_every_second() -> None:
    truths = [truth(block, LIGHT) for block in range(200)]
    estimates = {r: [estimate(r, b, LIGHT) for b in range(200)] for r in ROBOTS}
    report = built_report(recorded(truths, estimates, with_history=True))
    assert report.history is not None
    for points in report.history.values():
        assert [point.time_s for point in points] == pytest.approx([1.0, 2.0, 3.0, 4.0])


def test_the_report_is_plain_json() -> None:
    truths, estimates = changing_run(dict.fromkeys(ROBOTS, 110), {"r1": 2.06})
    table = json.loads(msgspec.json.encode(built_report(recorded(truths, estimates))))
    assert {"scenario", "seed", "estimator", "robots", "load_changes", "consensus"} <= set(table)
    assert {"processes", "real_time_factor", "messages_per_s"} <= set(table)
    assert set(table["robots"]["r1"]["mass"]) == {"truth", "estimate", "std", "error_pct"}


def test_silent_robots_are_named() -> None:
    assert recorded([truth(0, LIGHT)], {"r1": [estimate("r1", 0, LIGHT)]}).silent == ["r2", "r3"]

"""Runs in Python: the same numbers as in processes, as arrays, that can be kept and shown."""

from __future__ import annotations

import numpy as np
import pytest

import coheft
from coheft.app.run.inprocess import run_in_process
from coheft.errors import CoheftError, ScenarioError, UsageError

SHORT = 2.0


@pytest.fixture(scope="module")
def result() -> coheft.Result:
    return coheft.run("ring3", duration=SHORT, set={"load_changes": [{"at": 1.5, "mass": 2.0}]})


def test_it_has_what_each_robot_said_over_time(result):
    said = [
        record.estimates["r2"] for record in run_in_process(coheft.load_scenario(result.scenario)) if record.estimates
    ]
    robot = result.robots["r2"]
    np.testing.assert_array_equal(robot.time, [estimate.time for estimate in said])
    for k, payload in enumerate(estimate.payload for estimate in said):
        if payload is None:
            assert np.isnan(robot.mass.estimate[k])
            assert np.isnan(robot.mass.std[k])
        else:
            assert robot.mass.estimate[k] == payload.mass
            assert robot.mass.std[k] == pytest.approx(np.sqrt(payload.covariance[0, 0]))
    last = next(estimate for estimate in reversed(said) if estimate.payload and estimate.payload.tensor is not None)
    k = int(np.flatnonzero(robot.time == last.time)[0])
    np.testing.assert_array_equal(robot.com.estimate[k], last.payload.com)
    np.testing.assert_allclose(robot.inertia.estimate[k], last.payload.tensor)
    assert robot.inertia.std.shape == (len(robot.time), 3, 3)
    assert list(robot.valid) == [estimate.status == "valid" for estimate in said]


def test_truth_is_what_was_held_at_the_time(result):
    robot = result.robots["r1"]
    assert set(robot.mass.truth[robot.time <= 1.5]) == {5.0}
    assert robot.mass.truth[-1] == 7.0
    assert [change.at_s for change in result.load_changes] == [1.5]
    assert list(robot.noticed) == [pytest.approx(result.load_changes[0].detected_at_s, abs=0.2)]


def test_poses_are_errors_of_matrices(result):
    pose = result.robots["r1"].poses["r2"]
    known = np.isfinite(pose.error).all(axis=1)
    assert known.any()
    difference = pose.truth[:3, 3] - pose.estimate[known][:, :3, 3]
    np.testing.assert_allclose(pose.error[known][:, 3:], difference)
    assert (np.linalg.norm(pose.error[known][-1]) <= 6.0 * np.linalg.norm(pose.std[known][-1])).all()


def test_the_report_is_that_of_the_command(result):
    assert result.report.robots["r1"].mass.estimate == pytest.approx(result.robots["r1"].mass.estimate[-1])
    assert result.converged is result.report.converged
    assert result.report.processes == 1


def test_it_is_shown_in_a_line(result: coheft.Result) -> None:
    robot = result.robots["r1"]
    shown = {
        repr(result): "Result(ring3, 2 s, 3 robots, not converged; attributes: scenario, robots, report, beside)",
        repr(robot): f"RobotResult({len(robot.time)} estimates until 2 s, ",
        repr(robot.mass): f"Track({len(robot.time)}, last ",
        repr(robot.inertia): f"Track({len(robot.time)} × 3 × 3, last [[",
        repr(robot.poses["r2"]): f"PoseTrack({len(robot.time)} poses, last at [",
    }
    for text, start in shown.items():
        assert text.startswith(start)
        assert len(text) < 300
        assert "\n" not in text


def test_it_is_read_as_it_was_saved(result, tmp_path):
    again = coheft.load(result.save(tmp_path / "run.npz"))
    assert again.report == result.report
    assert again.scenario == result.scenario
    for name, robot in result.robots.items():
        np.testing.assert_array_equal(again.robots[name].state, robot.state)
        np.testing.assert_array_equal(again.robots[name].inertia.std, robot.inertia.std)
        for other, pose in robot.poses.items():
            np.testing.assert_array_equal(again.robots[name].poses[other].estimate, pose.estimate)


def test_files_of_something_else_are_refused(result, tmp_path):
    with pytest.raises(CoheftError, match=r"ends with \.npz"):
        result.save(tmp_path / "run.csv")
    with pytest.raises(CoheftError, match="cannot be read"):
        coheft.load(tmp_path / "missing.npz")
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    with pytest.raises(CoheftError, match=r"expected a result that Result\.save"):
        coheft.load(tmp_path / "other.npz")
    (tmp_path / "text.npz").write_text("no archive")
    with pytest.raises(CoheftError, match=r"expected a result that Result\.save"):
        coheft.load(tmp_path / "text.npz")


def test_a_table_has_a_row_for_each_estimate(result):
    pytest.importorskip("pandas")
    frame = result.to_dataframe()
    assert len(frame) == sum(len(robot.time) for robot in result.robots.values())
    last = frame[frame.robot == "r2"].iloc[-1]
    robot = result.robots["r2"]
    assert last.true_mass_kg == 7.0
    np.testing.assert_array_equal(last.mass_kg, robot.mass.estimate[-1])
    np.testing.assert_array_equal(last.std_inertia_xy_kgm2, robot.inertia.std[-1, 0, 1])


def test_a_picture_has_a_curve_for_each_robot(result):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("agg")
    from matplotlib import pyplot

    axes = result.plot()
    labels = axes[0].get_legend_handles_labels()[1]
    pyplot.close(axes[0].figure)
    assert labels == ["truth", "r1", "r2", "r3"]


def test_arguments_hold_against_set():
    chosen = coheft.simulate("ring3", seed=7, set={"seed": 3, "sensors.rate": 200}).scenario
    assert (chosen.seed, chosen.sensors.rate) == (7, 200)


def test_errors_name_the_argument():
    with pytest.raises(ScenarioError, match=r"set=\{'sensors.rate': 300\}.*'sensors.rate'.*found 300"):
        coheft.run("ring3", set={"sensors.rate": 300})
    with pytest.raises(ScenarioError, match=r"^coheft\.run: key 'duration'.*found -1"):
        coheft.run("ring3", duration=-1)
    with pytest.raises(UsageError, match="processes=True"):
        coheft.run("ring3", restarts=1)
    with pytest.raises(ScenarioError, match="Did you mean 'ring3'"):
        coheft.run("rng3")


@pytest.mark.slow
def test_processes_give_the_same_numbers():
    alone, processes = (coheft.run("ring3", duration=SHORT, processes=many) for many in (False, True))
    assert processes.report.processes == 4
    for name, robot in alone.robots.items():
        for quantity in ("mass", "com", "inertia"):
            expected, found = (getattr(each, quantity).estimate for each in (robot, processes.robots[name]))
            np.testing.assert_array_equal(found, expected)

"""From simulated experiments to the load: the paper's payloads, a ring of sensors, and the command line."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from coheft.app.cli.base import EXIT_CONVERGED, EXIT_ERROR, EXIT_NOT_CONVERGED, EXIT_USAGE
from coheft.app.cli.main import run_command_line
from coheft.app.identify.choices import Bounds, Method, Options
from coheft.app.identify.methods import fitted, identify
from coheft.app.identify.report import make_report
from coheft.app.mocobots.campaign import errors_of, scenario_of
from coheft.app.mocobots.record import record, record_sphere
from coheft.app.run.inprocess import run_in_process
from coheft.errors import RecordingError, UsageError
from coheft.estimation.batch.holds import holds_of
from coheft.estimation.batch.identification import Identification
from coheft.estimation.batch.recording import Recording
from coheft.estimation.geometry.body_motion import perturbation_between
from coheft.estimation.geometry.spatial import Pose
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.wire.data.file import write_recording
from coheft.wire.messages.structs import Estimate
from coheft.wire.scenario.encoders import EncoderErrors
from coheft.wire.scenario.file import load_scenario

EXPERIMENTS = [("b", 2), ("c", 1)]
"""Configurations of the paper, from via point to via point (1) or on a sphere (2)."""
AT_VIBRATION = [0.05] * 3 + [1.0] * 3 + [0.01, 1.5] + [1.0] * 3
"""Limits of errors without calibration errors: degrees, mm, kg, mm, %."""


@pytest.fixture(scope="module", params=[EXPERIMENTS[0], pytest.param(EXPERIMENTS[1], marks=pytest.mark.slow)], ids=str)
def vibrating(request: pytest.FixtureRequest) -> Recording:
    configuration, number = request.param
    scenario = scenario_of(configuration, "vibration", number)
    return record(scenario) if number % 2 else record_sphere(scenario)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["instruments", "pose"])
def test_loads_are_found_to_the_limits(vibrating: Recording, method: Method) -> None:
    found = identify(vibrating, Options(method=method))
    errors = np.abs(errors_of(vibrating, found))
    assert (errors < AT_VIBRATION).all(), errors
    report = make_report("b", vibrating, found)
    assert report.not_observable == []
    assert not [remark for remark in report.remarks if "fail to close by" in remark]
    assert honest(vibrating, found)


@pytest.fixture(scope="module")
def least_squares(vibrating: Recording) -> Identification:
    return identify(vibrating, Options(method="batch"))


def test_plain_least_squares_finds_all_but_the_inertia(vibrating: Recording, least_squares: Identification) -> None:
    """It is too small by the noise of differentiated encoders."""
    errors = np.array(errors_of(vibrating, least_squares))
    assert (np.abs(errors[:8]) < [0.05] * 3 + [4.0] * 3 + [0.01, 4.0]).all(), errors
    assert errors[8:].max() < -0.3


def test_the_bias_of_plain_least_squares_is_counted_in(vibrating: Recording, least_squares: Identification) -> None:
    found = least_squares
    assert vibrating.truth is not None
    error = found.payload.inertia.central() - vibrating.truth.loads[0][1].central()
    assert np.max(np.abs(error) / found.payload.std) < 5.0
    assert any("times the errors by noise; the standard deviations include it" in remark for remark in found.remarks)
    first = vibrating.truth.poses[0].inverse()
    for k in range(1, len(found.names)):
        relative = found.team.relative(0, k)
        off = perturbation_between(relative.pose, first @ vibrating.truth.poses[k])
        assert (np.abs(off) < 4.0 * np.sqrt(np.diag(relative.covariance))).all()


@pytest.mark.slow
def test_only_noise_keeps_inertias_from_being_exact() -> None:
    """Via points are fast: plain central differences would make inertias 0.2 % too large."""
    scenario = scenario_of("a", "vibration", 1)
    exact = EncoderErrors(angle_bits=32, position_step=1e-12, vibration_deg=0.0, vibration_mm=0.0)
    noise = msgspec.structs.replace(scenario.sensors.noise, force=1e-9)
    sensors = msgspec.structs.replace(scenario.sensors, encoders=exact, noise=noise)
    recording = record(msgspec.structs.replace(scenario, sensors=sensors, duration=90.0))
    errors = errors_of(recording, identify(recording, Options(method="pose")))
    assert np.abs(errors[8:]).max() < 0.04
    assert errors[7] < 0.02


def test_all_holds_are_found(vibrating: Recording) -> None:
    assert len(holds_of(vibrating).spans) == 6


def honest(recording: Recording, found: Identification, limit: float = 4.5) -> bool:
    """Whether all numbers are within some of their own standard deviations of the truth."""
    truth = recording.truth
    assert truth is not None
    load = truth.load_between(recording.time[0], recording.time[-1])
    assert load is not None
    deviations = [(found.payload.measured.central() - load.central()) / found.payload.std]
    for k in range(1, len(found.names)):
        relative = found.team.relative(0, k)
        error = perturbation_between(relative.pose, truth.poses[0].inverse() @ truth.poses[k])
        deviations.append(error / np.sqrt(np.diag(relative.covariance)))
    return bool(np.abs(np.concatenate(deviations)).max() < limit)


@pytest.fixture(scope="module")
def miscalibrated() -> Recording:
    return record_sphere(scenario_of("d", "calibration", 4))


@pytest.fixture(scope="module")
def short(miscalibrated: Recording) -> Recording:
    return miscalibrated.between(0.0, 60.0)


@pytest.fixture(scope="module")
def calibrated(short: Recording) -> Identification:
    return identify(short, Options(calibrate=True))


@pytest.fixture(scope="module")
def by_holds(miscalibrated: Recording) -> Identification:
    return identify(miscalibrated, Options(method="batch"))


def test_what_calibration_leaves_is_judged(calibrated: Identification) -> None:
    assert calibrated.verdict is not None
    assert calibrated.doubts == ()


def test_calibration_is_estimated_along_and_told(
    miscalibrated: Recording, short: Recording, calibrated: Identification, by_holds: Identification
) -> None:
    found = calibrated
    assert honest(short, found)
    unobservable = {finding.what for finding in found.calibration if not finding.seen}
    assert unobservable >= {"zero of angle c", "force scale", "force offset z"}
    assert not unobservable & {
        "zero of angle a",
        "zero of angle b",
        "scale of angle a",
        "force offset x",
        "force offset y",
    }
    plain, ours = (np.abs(errors_of(miscalibrated, each)) for each in (by_holds, found))
    assert ours[3:6].mean() < plain[3:6].mean()
    assert ours[7] < plain[7]


def test_calibration_is_estimated_from_little_more_than_a_second_of_motion(miscalibrated: Recording) -> None:
    found = identify(miscalibrated.between(40.0, 45.5), Options(method="pose", calibrate=True, cutoff=10.0))
    assert honest(miscalibrated, found)
    assert found.payload.is_seen("mass")


def test_shorter_motions_are_refused_and_how_long_to_record_is_told(miscalibrated: Recording) -> None:
    with pytest.raises(RecordingError, match=r"from 20 s to 24\.8 s, .* too little is left .* Record at least 5 s"):
        identify(miscalibrated.between(20.0, 24.8), Options(method="pose", calibrate=True, cutoff=10.0))


def test_robots_worse_than_their_bounds_are_suspected(short: Recording, calibrated: Identification) -> None:
    doubt = "No calibration errors within the bounds explain this recording: the force offset "
    tight = identify(short, Options(method="pose", calibrate=True, bounds=Bounds(force_offset=0.01)))
    for found, beyond in ((calibrated, False), (tight, True)):
        assert any(text.startswith(doubt) for text in found.suspicions) == beyond
        assert (found.doubts != ()) == beyond


@pytest.mark.slow
def test_a_force_scale_beyond_its_bound_is_refuted_until_the_bound_covers_it(short: Recording) -> None:
    robot = short.robots["r1"]
    assert robot.wrench is not None
    wrong = replace(short, robots={**short.robots, "r1": replace(robot, wrench=1.1 * robot.wrench)})
    refuted = identify(wrong, Options(calibrate=True))
    assert any("the force scale of r1 would be" in doubt for doubt in refuted.doubts)
    covered = identify(wrong, Options(calibrate=True, bounds=Bounds(force_scale=0.15)))
    assert covered.doubts == ()
    assert honest(wrong, covered)


@pytest.mark.slow
def test_who_ignores_calibration_errors_is_not_honest_and_warned(miscalibrated: Recording) -> None:
    found = identify(miscalibrated, Options(method="pose"))
    assert not honest(miscalibrated, found)
    warnings = [remark for remark in make_report("d", miscalibrated, found).remarks if "fail to close by" in remark]
    assert len(warnings) == 1
    assert "Try --method pose --calibrate" in warnings[0]


def test_only_poses_tell_calibration_errors(miscalibrated: Recording) -> None:
    with pytest.raises(UsageError, match="by --method pose only, not by batch"):
        identify(miscalibrated, Options(method="batch", calibrate=True))


@pytest.fixture(scope="module")
def ring6() -> tuple[Recording, dict[str, Estimate]]:
    """What sensors of six robots recorded, and what their agents thought at the end."""
    scenario = msgspec.structs.replace(load_scenario("ring6"), duration=10.0)
    last: dict[str, Estimate] = {}
    for block in run_in_process(scenario):
        last = block.estimates or last
    return record(scenario), last


@pytest.mark.parametrize("method", ["likelihood", "instruments"])
def test_recordings_say_what_agents_found_online(ring6: tuple[Recording, dict[str, Estimate]], method: Method) -> None:
    """Both have the same data: they agree within the standard deviations that both state.

    Agents learn poses from wrenches as well, so theirs are smaller.
    """
    recording, online = ring6
    found = identify(recording, Options(method=method))
    for k, (name, estimate) in enumerate(online.items()):
        payload = estimate.payload
        assert payload is not None
        seen = found.payload.inertia.transported(found.team.poses[k].inverse())
        theirs = Inertia(payload.mass, payload.com, payload.tensor)
        difference = seen.central() - theirs.central()
        own = np.sqrt(np.diag(payload.covariance))
        if method == "likelihood":
            assert np.abs(difference / own).max() < 3.0, name
        else:
            assert np.abs(difference).max() < 0.2
            assert np.abs(difference / np.hypot(own, 1.5 * own)).max() < 4.0, name
        for other, pose in estimate.poses.items():
            relative = found.team.relative(k, recording.names.index(other))
            error = perturbation_between(Pose(pose.rotation, pose.translation), relative.pose)
            variances = np.diag(pose.covariance)
            assert np.abs(error / np.sqrt(variances + np.diag(relative.covariance))).max() < 4.0, (name, other)


def test_the_suitable_method_is_chosen(
    ring6: tuple[Recording, dict[str, Estimate]], calibrated: Identification
) -> None:
    assert identify(ring6[0]).method == "likelihood"
    assert calibrated.method == "pose"


def test_the_cutoff_is_that_of_the_filter(
    ring6: tuple[Recording, dict[str, Estimate]], miscalibrated: Recording, by_holds: Identification
) -> None:
    masses = [fitted(miscalibrated, "batch", Options(cutoff=cutoff)).payload.inertia.mass for cutoff in (5.0, 2.0)]
    assert by_holds.payload.inertia.mass == masses[0] != masses[1]
    with pytest.raises(UsageError, match="--method likelihood has no filter: leave --cutoff out"):
        identify(ring6[0], Options(cutoff=2.0))


def test_without_holds_the_papers_method_says_what_is_missing(ring6: tuple[Recording, dict[str, Estimate]]) -> None:
    with pytest.raises(RecordingError, match=r"at least 2 orientations.*found 0 in 0 holds\."):
        identify(ring6[0], Options(method="batch"))


def test_a_load_that_changed_is_suspected() -> None:
    scenario = load_scenario("ring6")
    change = msgspec.structs.replace(scenario.load_changes[0], at=3.0)
    recording = record(msgspec.structs.replace(scenario, duration=6.0, load_changes=(change,)))
    assert identify(recording).doubts != ()
    assert "did the load change" not in identify(recording.between(3.0, 6.0)).remarks[0]
    assert identify(recording.between(3.0, 6.0)).doubts == ()


def test_a_load_that_hardly_moves_is_not_weighed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario = msgspec.structs.replace(load_scenario("quiet"), duration=10.0)
    write_recording(record(scenario), tmp_path / "quiet.npz")
    assert run_command_line(["identify", str(tmp_path / "quiet.npz")]) == EXIT_NOT_CONVERGED
    shown = " ".join(capsys.readouterr().out.split())
    assert "Not observable: pose of r2" in shown
    assert "not observable" in shown


def test_the_command_line_reports(short: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    path, report, folder = tmp_path / "d.npz", tmp_path / "d.json", tmp_path / "report"
    robots = short.robots
    named = replace(short, robots={"r1": robots["r1"], "arm[left]": robots["r2"], "r3": robots["r3"]})
    write_recording(named, path)
    arguments = ["identify", str(path), "--calibrate", "--json", str(report), "--report", str(folder)]
    assert run_command_line(arguments) == EXIT_CONVERGED
    shown = capsys.readouterr().out
    assert "Calibration" in shown
    assert " no " in shown  # some errors are not observable
    told = json.loads(report.read_text())
    assert (told["method"], told["robots"]) == ("pose", ["r1", "arm[left]", "r3"])
    for table in shown.split("Grasps")[1].split("Calibration"):
        assert "arm[left]" in table  # though brackets are style for rich
    principal = np.linalg.eigvalsh(np.array(told["payload"]["inertia"]))
    np.testing.assert_allclose(told["payload"]["principal"], principal)
    assert abs(told["errors"]["mass_kg"]) < 0.5
    assert {file.name for file in folder.iterdir()} >= {"report.json", "report.txt", "residuals.png", "forces.png"}


def test_the_command_line_says_what_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["identify", str(tmp_path / "nothing.npz")]) == EXIT_ERROR
    assert "nothing.npz: cannot be read" in capsys.readouterr().err


def test_data_cannot_be_saved_where_there_is_no_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "no" / "run.npz"
    assert run_command_line(["run", "mocobot_a", "--save-data", str(target)]) == EXIT_USAGE
    assert "there is no folder" in " ".join(capsys.readouterr().err.replace("│", " ").split())

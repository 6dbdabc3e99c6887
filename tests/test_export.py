"""Loads for models and arms: the same body, in each one's own frame and units; nothing that is not valid."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import coheft
from coheft.app.cli.base import EXIT_CONVERGED, EXIT_ERROR, EXIT_NOT_CONVERGED, EXIT_USAGE
from coheft.app.cli.main import run_command_line
from coheft.app.export.formats import Limits, export_load, judge_load
from coheft.app.export.found_load import FoundLoad, of_recording
from coheft.errors import CoheftError, UsageError
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.mass_properties import Inertia
from tests.estimation.batch_team import LOAD
from tests.ring3_recording import MASS, ring3_arrays

FRAME = "flange"
FOUND = FoundLoad(LOAD, 0.02, np.array([1e-3, 2e-3, 3e-3]), np.full((3, 3), 0.01), "r1", "a test")


def numbers(text: str) -> Array:
    return np.array([float(number) for number in re.findall(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?", text)])


def of_engine(xml: str) -> Inertia:
    """The body of a model as MuJoCo has it."""
    model = mujoco.MjModel.from_xml_string(xml)
    body = model.nbody - 1
    axes = Rotation.from_quat(model.body_iquat[body], scalar_first=True).as_matrix()
    tensor = axes @ np.diag(model.body_inertia[body]) @ axes.T
    return Inertia(float(model.body_mass[body]), model.body_ipos[body].copy(), tensor)


def assert_same(found: Inertia, expected: Inertia) -> None:
    assert found.mass == pytest.approx(expected.mass)
    np.testing.assert_allclose(found.com, expected.com, atol=1e-6)
    np.testing.assert_allclose(found.tensor, expected.tensor, atol=1e-6)


def test_mjcf_is_the_same_body_for_mujoco() -> None:
    inertial = export_load(FOUND, "mjcf", FRAME)
    assert_same(of_engine(f"<mujoco><worldbody><body>{inertial}<freejoint/></body></worldbody></mujoco>"), LOAD)


def test_urdf_is_the_same_body_for_mujoco() -> None:
    inertial = export_load(FOUND, "urdf", FRAME)
    link = f'<link name="world"/><link name="load">{inertial}</link>'
    joint = '<joint name="j" type="floating"><parent link="world"/><child link="load"/></joint>'
    assert_same(of_engine(f'<robot name="r">{link}{joint}</robot>'), LOAD)


def test_franka_has_columns_in_metres() -> None:
    line = export_load(FOUND, "franka", FRAME).splitlines()[-1]
    assert line.startswith("robot.setLoad(")
    values = numbers(line)
    np.testing.assert_allclose(values[1:4], LOAD.com)
    np.testing.assert_allclose(values[4:].reshape(3, 3).T, LOAD.tensor)


def test_universal_robots_have_six_moments() -> None:
    line = export_load(FOUND, "ur", FRAME).splitlines()[-1]
    assert line.startswith("set_target_payload(")
    np.testing.assert_allclose(numbers(line), LOAD.central())


@pytest.mark.parametrize(
    "tensor",
    [LOAD.tensor, np.diag([2.0, 3.0, 4.0]), np.diag([3.0, 4.0, 2.0]), np.diag([4.0, 2.0, 3.0])],
    ids=["any axes", "in order", "B of 90 degrees", "B of 90 degrees, the other way"],
)
def test_kuka_has_millimetres_and_angles_of_principal_axes(tensor: Array) -> None:
    load = replace(FOUND, inertia=Inertia(LOAD.mass, LOAD.com, tensor))
    line = export_load(load, "kuka", FRAME).splitlines()[-1]
    assert "e" not in line.partition("=")[2], "KRL has no such numbers"
    values = dict(re.findall(r"([MXYZABC]) ([-\d.]+)", line.partition("J ")[0]))
    moments = numbers(line.partition("J ")[2])
    axes = Rotation.from_euler("ZYX", [float(values[name]) for name in "ABC"], degrees=True).as_matrix()
    np.testing.assert_allclose(axes @ np.diag(moments) @ axes.T, tensor, atol=1e-5)
    np.testing.assert_allclose([float(values[name]) for name in "XYZ"], 1e3 * LOAD.com, atol=1e-5)
    assert float(values["M"]) == pytest.approx(LOAD.mass)


def test_controllers_get_what_they_take() -> None:
    large = FoundLoad(Inertia(300.0, LOAD.com, 100.0 * LOAD.tensor), 1.0, FOUND.com_std, FOUND.tensor_std, "r1", "t")
    with pytest.raises(CoheftError, match="up to 133 kg·m²"):
        export_load(large, "ur", FRAME)


def test_standard_deviations_in_another_frame_are_bounds() -> None:
    pose = Pose(Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix(), np.array([0.1, 0.0, -0.2]))
    seen = FOUND.seen_from(pose)
    assert_same(seen.inertia, LOAD.transported(pose))
    rng = np.random.default_rng(0)
    errors = rng.choice([-1.0, 1.0], size=(1000, 3)) * FOUND.com_std  # as large, and as dependent, as may be
    assert (np.abs(errors @ pose.rotation.T) <= seen.com_std + 1e-12).all()


@pytest.mark.parametrize(
    ("limits", "answer"),
    [
        (Limits(), "within"),
        (Limits(mass=8.1), "within"),
        (Limits(mass=8.05), "unclear"),
        (Limits(mass=7.9), "exceeds"),
        (Limits(mass=8.1, offset=0.3), "exceeds"),
        (Limits(offset=0.345), "unclear"),
        (Limits(inertia=3.2), "within"),
        (Limits(inertia=2.5), "exceeds"),
    ],
)
def test_verdicts_know_what_they_cannot_tell(limits: Limits, answer: str) -> None:
    assert judge_load(FOUND, limits, FRAME).answer == answer


@pytest.fixture(scope="module")
def result() -> coheft.Result:
    return coheft.run("ring3", duration=4.0)


@pytest.fixture(scope="module")
def report(result: coheft.Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.json"
    path.write_bytes(msgspec.json.encode(result.report))
    return path


def test_a_run_is_exported_in_python_as_by_the_command(
    result: coheft.Result, report: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    flange = ("0", "0", "0.1", "0", "0", "90")
    arguments = ["export", str(report), "--as", "ur", "--robot", "r2", "--flange", *flange]
    assert run_command_line(arguments) == EXIT_CONVERGED
    printed = capfd.readouterr().out.splitlines()
    text = coheft.export(result, "ur", robot="r2", flange=(0, 0, 0.1, 0, 0, 90))
    assert text.splitlines()[1:] == printed[1:]
    x, y, z = np.array(result.report.robots["r2"].com.estimate)
    np.testing.assert_allclose(numbers(printed[-1])[1:4], [-y, x, z + 0.1])


def test_the_exit_status_of_a_verdict_is_its_answer(report: Path, tmp_path: Path) -> None:
    target = tmp_path / "verdict.json"
    arguments = ["export", str(report), "--as", "verdict", "--to", str(target), "--max-mass"]
    assert run_command_line([*arguments, "6"]) == EXIT_CONVERGED
    assert json.loads(target.read_text())["answer"] == "within"
    assert run_command_line([*arguments, "4"]) == EXIT_NOT_CONVERGED
    assert json.loads(target.read_text())["mass"]["answer"] == "exceeds"


def changed(report: Path, folder: Path, **changes: Any) -> str:
    """A report in which the first robot says something else."""
    table = json.loads(report.read_text())
    for key, value in changes.items():
        first, _, second = key.partition("__")
        if second:
            table["robots"]["r1"][first][second] = value
        else:
            table["robots"]["r1"][first] = value
    path = folder / "changed.json"
    path.write_text(json.dumps(table))
    return str(path)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"status": "stale", "reasons": ["r2 is silent since 3.1 s"]}, "is stale, not valid.*r2 is silent since 3.1 s"),
        ({"status": "starting"}, "is starting, not valid.*it has not found the load yet"),
        ({"inertia__estimate": None, "not_observable": ["inertia: turn the load"]}, "r1 does not know all.*turn the"),
        ({"mass__estimate": -5.0}, "no body can have"),
        ({"inertia__estimate": [[9.0, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]}, "no body can have"),
        ({"com__estimate": [0.0, 0.1]}, "expected 3 numbers"),
    ],
)
def test_what_may_not_be_used_is_refused(
    report: Path, tmp_path: Path, changes: dict[str, Any], complaint: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(["export", changed(report, tmp_path, **changes), "--as", "franka"]) == EXIT_ERROR
    out, err = capfd.readouterr()
    assert out == ""
    assert re.search(complaint, err), err


def test_what_makes_no_sense_is_refused(report: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "other.json").write_text('{"answer": 42}')
    for arguments, status, complaint in (
        ([str(report), "--as", "ur", "--max-mass", "3"], EXIT_USAGE, "add --as verdict"),
        ([str(report), "--as", "ur", "--robot", "r9"], EXIT_ERROR, "the robots are r1, r2, r3"),
        ([str(report), "--as", "ur", "--run", "x"], EXIT_USAGE, "leave one out"),
        ([str(tmp_path / "none.json"), "--as", "ur"], EXIT_ERROR, "cannot be read"),
        ([str(tmp_path / "other.json"), "--as", "ur"], EXIT_ERROR, "expected a report of 'coheft run --json'"),
        ([str(report), "--as", "abb"], EXIT_USAGE, "urdf"),
    ):
        assert run_command_line(["export", *arguments]) == status
        assert complaint in capfd.readouterr().err


def test_recordings_tell_the_first_robot_s_frame() -> None:
    found = coheft.identify(ring3_arrays())
    load = of_recording(found, None, "a recording")
    assert load.inertia.mass == pytest.approx(MASS, abs=6.0 * load.mass_std)
    assert load.mass_std < 0.01
    np.testing.assert_allclose(numbers(coheft.export(found, "ur").splitlines()[-1])[0], load.inertia.mass)
    with pytest.raises(CoheftError, match="in the grasp frame of r1 only"):
        coheft.export(found, "ur", robot="r2")
    with pytest.raises(CoheftError, match=r"nothing of arrays is to be used: forces have the wrong sign"):
        coheft.export(msgspec.structs.replace(found, doubts=["forces have the wrong sign"]), "ur")
    with pytest.raises(UsageError, match="for a verdict"):
        coheft.export(found, "ur", max_mass=3.0)

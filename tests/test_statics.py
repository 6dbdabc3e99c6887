"""Loads that are held still, recorded apart from their motion, or without any."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from coheft.app.cli.base import EXIT_ERROR, EXIT_NOT_CONVERGED, EXIT_USAGE
from coheft.app.cli.main import run_command_line
from coheft.app.identify.choices import Options
from coheft.app.identify.methods import identify, read_holds
from coheft.errors import RecordingError
from coheft.estimation.batch.identify_statics import identify_statics
from coheft.estimation.batch.recording import Recording, RobotRecord
from coheft.estimation.geometry.spatial import Array
from coheft.wire.data.checks import COLUMNS
from coheft.wire.data.file import write_recording
from tests import bar
from tests.statics import COM, GRASPS, MASS, NAMES, TILTS, statics


def write_lines(folder: Path, held: Recording, time: Array | None = None, samples: int = 1) -> None:
    """CSV files, with some samples of each hold, and maybe times."""
    for name, pose, wrench in zip(held.names, held.stacked("pose"), held.stacked("wrench"), strict=True):
        header = [*(["t"] if time is not None else []), *COLUMNS["pose"], *COLUMNS["wrench"]]
        rows = np.repeat(np.hstack([pose, wrench[:, 3:], wrench[:, :3]]), samples, axis=0)
        rows = rows if time is None else np.column_stack([time, rows])
        lines = [",".join(map(repr, row)) for row in rows.tolist()]
        (folder / f"{name}.csv").write_text("\n".join([",".join(header), *lines]))


def test_without_noise_all_but_the_inertia_is_exact() -> None:
    found = identify_statics(statics(noise=0.0))
    assert found.doubts == ()
    np.testing.assert_allclose(found.payload.measured.central()[:4], [MASS, *COM], atol=1e-7)
    for grasp, pose in zip(GRASPS, found.team.poses, strict=True):
        np.testing.assert_allclose(pose.translation, grasp.translation, atol=1e-7)
        np.testing.assert_allclose(pose.rotation, grasp.rotation, atol=1e-7)
    assert {part.quantity for part in found.payload.unobservable} == {"inertia"}


@pytest.mark.parametrize("count", [3, 6])
def test_standard_deviations_are_true_of_few_holds(count: int) -> None:
    squares = []
    for seed in range(30):
        found = identify_statics(statics(seed, tilts=TILTS[[0, 1, 3, 2, 4, 5][:count]]))
        assert found.doubts == ()
        error = found.payload.measured.central()[:4] - [MASS, *COM]
        squares.append(error @ np.linalg.solve(found.payload.covariance[:4, :4], error) / 4.0)
    assert 0.3 < np.mean(squares) < 1.6


def still_seconds(rate: float = 100.0) -> Array:
    """Times of six holds of half a second each, minutes apart [s]."""
    return np.concatenate([60.0 * k + np.arange(0.0, 0.5, 1.0 / rate) for k in range(6)])


@pytest.mark.parametrize(
    ("time", "samples"),
    [(None, 1), (60.0 * np.arange(6), 1), (still_seconds(), 50), (1e3 * still_seconds(), 50)],
    ids=["lines", "lines with times", "stretches of samples", "in milliseconds"],
)
def test_holds_are_read_as_people_record_them(tmp_path: Path, time: Array | None, samples: int) -> None:
    written = statics()
    write_lines(tmp_path, written, time, samples)
    read = read_holds(tmp_path, NAMES)
    pose, expected = read.stacked("pose"), written.stacked("pose")
    np.testing.assert_allclose(pose[..., :3], expected[..., :3])
    np.testing.assert_allclose(np.abs(np.einsum("rhi,rhi->rh", pose[..., 3:], expected[..., 3:])), 1.0)
    np.testing.assert_allclose(read.stacked("wrench"), written.stacked("wrench"))


def test_quaternions_of_three_digits_do_not_turn_from_line_to_line(tmp_path: Path) -> None:
    """Their norms differ from one, by more than the cosine of small angles does."""
    write_lines(tmp_path, statics().changed("pose", lambda pose: np.round(pose, 3)), still_seconds(), 50)
    assert read_holds(tmp_path, NAMES).stacked("pose").shape == (3, 6, 7)


def test_lines_without_times_are_in_no_unit(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    write_lines(tmp_path, statics())
    read_holds(tmp_path, NAMES)
    assert caplog.text == ""


def test_holds_in_one_orientation_are_counted(tmp_path: Path) -> None:
    same = bar_held().changed("pose", lambda pose: pose[[0, 0, 0]]).changed("wrench", lambda wrench: wrench[[0, 0, 0]])
    with pytest.raises(RecordingError, match=r"found 1 in 3 holds\. Hold it in others as well, .* without --holds"):
        identify(moving(0.2), Options(method="pose"), statics=same)


def test_holds_without_motion_are_identified_by_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_lines(tmp_path, statics())
    command = ["identify", str(tmp_path), "--method", "static", "--json", str(tmp_path / "x.json")]
    assert run_command_line(command) == EXIT_NOT_CONVERGED
    words = " ".join(capsys.readouterr().out.split())
    assert "3 robots, held still, method static" in words
    assert "The load was held still: 6 holds in 6 orientations." in words
    report = json.loads((tmp_path / "x.json").read_text())
    assert report["payload"]["mass_kg"] == pytest.approx(MASS, abs=5 * report["payload"]["mass_std_kg"])
    assert report["payload"]["inertia"] is None
    assert report["doubts"] == []
    assert run_command_line(["identify", str(tmp_path)]) == EXIT_ERROR
    assert "'t' of a is missing: the times of its samples; if each line is a hold: --method static" in (
        " ".join(capsys.readouterr().err.split())
    )
    assert run_command_line([*command, "--from", "1"]) == EXIT_USAGE


def moving(noise: float) -> Recording:
    """The bar, with noise of its forces [N]; its wrenches need no other noise to leave its mass uncertain."""
    rng, time = np.random.default_rng(0), np.arange(0.0, 20.0, 0.01)
    spread = noise * np.repeat([1.0, 0.05], 3)
    return Recording(
        {
            name: RobotRecord(
                time, pose=bar.poses(time, name), wrench=bar.wrenches(time) + spread * rng.normal(size=(len(time), 6))
            )
            for name in bar.ENDS
        }
    )


def bar_held(offset: float = 0.0) -> Recording:
    """The bar at some of its poses, as if it were held there; each robot's force may be too large by an offset [N]."""
    time = np.array([0.5, 1.7, 3.1, 4.4, 6.0])
    exact = bar.wrenches(time)
    wrench = np.hstack([exact[:, :3], np.zeros((5, 3))]) + [0.0, 0.0, offset, 0.0, 0.0, 0.0]
    wrench += 1e-3 * np.random.default_rng(1).normal(size=wrench.shape)
    return Recording({name: RobotRecord(time, pose=bar.poses(time, name), wrench=wrench) for name in bar.ENDS})


@pytest.mark.parametrize("method", ["pose", "instruments", "batch"])
def test_holds_make_motion_more_certain(method: str) -> None:
    recording = moving(5.0)
    together = identify(recording, Options(method=method), statics=bar_held())  # type: ignore[arg-type]
    assert together.suspicions == ()
    error = together.payload.measured.central()[:4] - [bar.MASS, 0.5, 0.0, 0.0]
    assert (np.abs(error) < 4.5 * together.payload.std[:4]).all()
    assert together.payload.std[0] < 2e-3
    if method == "batch":  # it has no holds of its own, and could not do without
        with pytest.raises(RecordingError, match="held still in at least 2 orientations"):
            identify(recording, Options(method=method))
        return
    alone = identify(recording, Options(method=method))  # type: ignore[arg-type]
    assert together.payload.std[0] < 0.5 * alone.payload.std[0]
    assert alone.payload.is_seen("inertia")
    assert together.payload.is_seen("inertia")


def test_holds_of_another_load_are_suspected() -> None:
    assert "is it the same load" in identify(moving(0.2), Options(method="pose"), statics=bar_held(1.0)).doubts[-1]


def test_forces_across_gravity_are_suspected() -> None:
    held = statics().changed("wrench", lambda wrench: wrench[:, [1, 2, 0, 4, 5, 3]], NAMES[1])
    assert any("N across it" in doubt for doubt in identify_statics(held).doubts)


@pytest.mark.parametrize(
    ("tilts", "message"),
    [
        (TILTS[:2], "found 2 holds, expected at least 3"),
        (TILTS[[0, 0, 0, 0]], "found 1 orientations in 4 holds: they do not show where"),
    ],
)
def test_too_few_orientations_are_refused(tilts: Array, message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        identify_statics(statics(tilts=tilts))


def test_files_that_are_no_holds_are_refused(tmp_path: Path) -> None:
    write_lines(tmp_path, statics())
    with pytest.raises(RecordingError, match=r"found holds of a, b, c, expected those of left, right"):
        read_holds(tmp_path, ("left", "right"))
    (tmp_path / "c.csv").write_text("\n".join((tmp_path / "c.csv").read_text().splitlines()[:4]))
    with pytest.raises(RecordingError, match=r"found different numbers of lines: 6 of a, 6 of b, 3 of c; expected one"):
        read_holds(tmp_path)
    (tmp_path / "c.csv").write_text("fx,fy,fz,mx,my,mz\n1,2,3,4,5,6\n")
    with pytest.raises(RecordingError, match=r"'pose' of c is missing; found wrench; expected pose and wrench"):
        read_holds(tmp_path)
    write_recording(moving(0.1), tmp_path / "x.npz")
    with pytest.raises(RecordingError, match=r"x.npz: the load is never held still from 0 s to 19.99 s"):
        read_holds(tmp_path / "x.npz")


def test_holds_of_any_orientation_are_used() -> None:
    tilts = np.array([[0, 0, 0], [1.6, 0, 0], [0, 1.6, 0], [0, 0, 3.0], [2.2, -2.2, 0], [-1.6, 0, 0.5]])
    found = identify_statics(statics(tilts=tilts))
    assert found.doubts == ()
    assert found.payload.inertia.mass == pytest.approx(MASS, abs=5 * found.payload.std[0])


def test_a_load_that_turns_within_a_hold_is_refused(tmp_path: Path) -> None:
    held = statics().changed("pose", lambda pose: pose[[0, 0, 1, 1, 1, 1]])
    write_lines(tmp_path, held, np.array([0.0, 0.01, 0.02, 5.0, 5.01, 5.02]))
    with pytest.raises(RecordingError, match=r"hold 1, samples 1 to 3: the load turns by \d+°, expected one that is"):
        read_holds(tmp_path)

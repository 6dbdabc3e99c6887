"""The recording that docs/data-format.md has its readers write, right and spoiled as newcomers spoil it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from coheft.app.cli.base import EXIT_CONVERGED, EXIT_ERROR, EXIT_NOT_CONVERGED, EXIT_USAGE
from coheft.app.cli.main import run_command_line
from coheft.estimation.batch.plausibility import inverse_poses
from coheft.estimation.geometry.spatial import Array
from tests.docs_blocks import blocks

PAGE = Path(__file__).parents[1] / "docs" / "data-format.md"
Arrays = dict[str, Array]

pytestmark = pytest.mark.filterwarnings("error")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Arrays:
    """What the page's own block writes."""
    (text,) = [block.text for block in blocks(PAGE) if block.language == "python"]
    folder = tmp_path_factory.mktemp("page")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        exec(compile(text, PAGE.name, "exec"), {})
    return dict(np.load(folder / "mine.npz"))


@pytest.fixture(scope="module")
def still() -> Arrays:
    """A load of 4 kg that is held in one orientation all the time."""
    t = np.arange(0.0, 30.0, 0.01)
    pose = np.tile([0.0, 0.0, 1.0, 0.5, 0.0, 0.0, 0.75**0.5], (len(t), 1))
    down = np.tile([0.0, -(0.75**0.5), -0.5], (len(t), 1))
    wrench = np.hstack([np.zeros_like(down), -2.0 * 9.81 * down])
    return {f"{name}/{key}": x for name in "ab" for key, x in (("t", t), ("pose", pose), ("wrench", wrench))}


@pytest.fixture
def run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, dict[str, Any], str]]:
    """Identifies arrays: the exit status, the report, and what was said of errors."""

    def identify(arrays: Arrays, *options: str) -> tuple[int, dict[str, Any], str]:
        np.savez(tmp_path / "mine.npz", **arrays)
        status = run_command_line(["identify", str(tmp_path / "mine.npz"), "--quiet", "--json", "-", *options])
        shown = capsys.readouterr()
        return status, json.loads(shown.out) if shown.out else {}, shown.err

    return identify


Run = Callable[..., tuple[int, dict[str, Any], str]]


@pytest.mark.parametrize("method", ["instruments", "pose"])
def test_the_page_is_right_about_what_it_writes(page: Arrays, run: Run, method: str) -> None:
    """Without noise, all is exact up to the differences by which the block computes moments, and to means of poses."""
    status, report, _ = run(page, "--method", method)
    assert status == EXIT_CONVERGED
    assert (report["not_observable"], report["doubts"]) == ([], [])
    payload = report["payload"]
    assert payload["mass_kg"] == pytest.approx(4.0, abs=1e-5)
    np.testing.assert_allclose(payload["com_m"], [0.5, 0.0, 0.0], atol=1e-5)
    np.testing.assert_allclose(payload["principal"], [0.02, 0.33, 0.34], atol=1e-3)
    np.testing.assert_allclose(report["poses"]["right"]["position_m"], [1.0, 0.0, 0.0], atol=2e-5)


def test_other_methods_tell_what_the_page_does_not_write(page: Arrays, run: Run) -> None:
    for method, missing in (("batch", "at least 2 orientations"), ("likelihood", "'noise' is missing")):
        status, _, error = run(page, "--method", method)
        assert status == EXIT_ERROR
        assert "mine.npz: " in error
        assert missing in error
        assert error.count("\n") == 1


def test_calibrated_robots_are_exact_within_what_is_not_known_of_them(page: Arrays, run: Run) -> None:
    status, report, _ = run(page, "--calibrate")
    assert status == EXIT_CONVERGED
    payload = report["payload"]
    assert abs(payload["mass_kg"] - 4.0) < payload["mass_std_kg"] < 0.1


@pytest.mark.parametrize("options", [["--method", "instruments"], ["--method", "pose"], ["--calibrate"]], ids=str)
def test_no_number_is_given_for_what_a_still_load_does_not_show(still: Arrays, run: Run, options: list[str]) -> None:
    status, report, _ = run(still, *options)
    assert status == EXIT_NOT_CONVERGED
    assert report["poses"] == {"b": None}
    payload = report["payload"]
    assert {payload[key] for key in ("mass_kg", "com_m", "inertia", "principal")} == {None}
    told = " ".join(report["not_observable"])
    assert all(what in told for what in ("pose of b", "mass: first, all poses", "centre of mass", "inertia: turn"))
    assert report["doubts"] == []


def test_two_holds_show_mass_and_centre_of_mass_only_to_whoever_knows_the_grasps(still: Arrays, run: Run) -> None:
    status, report, _ = run(turned_over(still), "--method", "batch")
    assert status == EXIT_NOT_CONVERGED
    assert report["poses"] == {"b": None}
    assert report["hold_orientations"] == 2
    assert report["payload"]["mass_kg"] is None
    assert report["doubts"] == []


def turned_over(still: Arrays) -> Arrays:
    """The same, then turned by a right angle about one axis within three seconds, and held again."""
    arrays = {**still}
    angle = np.pi / 2.0 * np.clip((still["a/t"] - 13.0) / 3.0, 0.0, 1.0)
    turn = Rotation.from_rotvec(np.outer(angle, [1.0, 0.0, 0.0]))
    for robot in "ab":
        pose = still[f"{robot}/pose"]
        upright = Rotation.from_quat(pose[:, 3:])
        arrays[f"{robot}/pose"] = np.hstack([pose[:, :3], (turn * upright).as_quat()])
        force = (turn * upright).inv().apply([0.0, 0.0, 2.0 * 9.81])
        arrays[f"{robot}/wrench"] = np.hstack([np.zeros_like(force), force])
    return arrays


def jumping(arrays: Arrays) -> Arrays:
    """With the second half of another recording, in which robots stood 0.3 m further away."""
    later = np.outer(arrays["left/t"] > 20.0, [0.3] + [0.0] * 6)
    return every(arrays, "pose", lambda pose: pose + later)


def every(arrays: Arrays, channel: str, change: Callable[[Array], Array]) -> Arrays:
    return {key: change(array) if key.endswith(channel) else array for key, array in arrays.items()}


def real_part_first(pose: Array) -> Array:
    return pose[:, [0, 1, 2, 6, 3, 4, 5]]


def inverse_quaternions(pose: Array) -> Array:
    return pose * [1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 1.0]


SPOILED: list[tuple[Callable[[Arrays], Arrays], str]] = [
    (lambda a: every(a, "wrench", np.negative), "add up to -3.99 kg: they must be what the robots do to the load"),
    (lambda a: {**a, "gravity": np.array([0.0, 0.0, 9.81])}, r"gravity in the home frames, \(0, 0, 9.81\), must point"),
    (lambda a: every(a, "wrench", lambda w: w[:, [3, 4, 5, 0, 1, 2]]), "carry 3.99 kg: give the moment first"),
    (lambda a: every(a, "wrench", np.zeros_like), "all forces are zero"),
    (lambda a: every(a, "pose", lambda p: p * ([1e3] * 3 + [1.0] * 4)), "'pose' of left moves at .*, as millimetres"),
    (jumping, r"'pose' of left jumps at 20.01 s, by .* and 0.3 m within 0.02 s: choose a part without"),
    (lambda a: every(a, "pose", real_part_first), "'pose' of left, right: .* Move the real part to the end"),
    (lambda a: every(a, "right/pose", real_part_first), "'pose' of right: .* Move the real part to the end"),
    (lambda a: every(a, "pose", inverse_quaternions), "'pose' of left, right: .* Change the signs of qx qy qz"),
    (lambda a: every(a, "right/pose", inverse_poses), "'pose' of left, or of right: .* Invert them"),
]


@pytest.mark.parametrize(("spoil", "expected"), SPOILED, ids=[expected for _, expected in SPOILED])
@pytest.mark.parametrize("options", [[], ["--calibrate"], ["--method", "instruments"]], ids=str)
def test_what_cannot_be_is_refused(
    page: Arrays, run: Run, options: list[str], spoil: Callable[[Arrays], Arrays], expected: str
) -> None:
    status, _, error = run(spoil(page), *options)
    assert status == EXIT_ERROR
    assert re.search(expected, error), error


def test_one_wrench_of_the_wrong_sign_is_refuted(page: Arrays, run: Run) -> None:
    """The other one carries as much: nothing is lifted, and nothing is sure."""
    arrays = {**every(page, "right/wrench", lambda w: -0.5 * w)}
    status, report, _ = run(arrays)
    assert status == EXIT_NOT_CONVERGED
    assert report["verdict"]["refuted"]


def test_clocks_that_differ_are_named(page: Arrays, run: Run) -> None:
    arrays = {key: array[:-40] for key, array in page.items()}
    status, report, _ = run({**arrays, "right/pose": page["right/pose"][40:]})
    assert status == EXIT_NOT_CONVERGED
    assert any("ms early against the others" in doubt for doubt in report["doubts"])


@pytest.mark.parametrize(
    ("options", "status", "expected"),
    [
        (["--from", "30", "--to", "20"], EXIT_USAGE, "--from 30 is not before --to 20: give the earlier time first"),
        (["--from", "-5"], EXIT_USAGE, "--from -5 is outside the recording, which is from 0 s to 39.99 s"),
        (["--to", "50"], EXIT_USAGE, "--to 50 is outside the recording"),
        (["--to", "0.5"], EXIT_ERROR, "mine.npz: found 51 samples, but the filter takes more than 100: record for"),
        (["--to", "5"], EXIT_ERROR, "mine.npz: found samples from 0 s to 5 s, .* Record at least 7 s"),
        (["--from", "0", "--to", "40", "--method", "instruments"], EXIT_CONVERGED, ""),
    ],
)
def test_parts_are_those_that_were_recorded(
    page: Arrays, run: Run, options: list[str], status: int, expected: str
) -> None:
    found, _, error = run(page, *options)
    assert found == status, error
    assert re.search(expected, error), error

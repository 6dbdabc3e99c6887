"""``coheft cart identify``: carts from recordings, and files that are none."""

from __future__ import annotations

import io
import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from coheft.app.cart.explain import explanation
from coheft.app.cart.identify import CartIdentification
from coheft.app.cart.terminal import print_identification
from coheft.app.cli.base import EXIT_ERROR, EXIT_NOT_CONVERGED, EXIT_USAGE
from coheft.app.cli.main import run_command_line
from coheft.errors import RecordingError
from coheft.estimation.cart.contact import grasp_map
from coheft.estimation.cart.model import CartBody, axes, forward_dynamics
from coheft.estimation.geometry.spatial import Array
from coheft.wire.cart.recording import COLUMNS, read_cart_recording

BODY = CartBody(26.0, (0.35, 0.05), 3.0, (8.0, 3.0))
HAND = (-0.25, 0.1)
RATE, FINE = 50, 6
NOISE = 0.005


@cache
def driven(seconds: float = 16.0) -> dict[str, Array]:
    """A cart that is pushed ahead and to the sides; pushes are measured at the hand."""
    rng = np.random.default_rng(1)
    state, arrays = np.zeros(6), {name: [] for name in COLUMNS}
    for index in range(round(seconds * RATE)):
        time = index / RATE
        push = np.array([14.0 + 12.0 * np.sin(1.1 * time), 0.0, 5.0 * np.sin(0.9 * time)])
        total = grasp_map(np.array(HAND)) @ push
        for name, values in zip(
            COLUMNS, (np.array([time]), *np.split(state + NOISE * rng.standard_normal(6), 2), push, push), strict=True
        ):
            arrays[name].append(values)
        for _ in range(FINE):
            step = 1.0 / (RATE * FINE)
            moved = forward_dynamics(BODY.phi, BODY.friction, state[2], state[3:], total).accelerations
            state = state + step * np.concatenate([state[3:] + 0.5 * step * moved, moved])
    return {name: np.array(values) for name, values in arrays.items()}


def write_csv(path: Path, arrays: dict[str, Array]) -> Path:
    names = [column for name, columns in COLUMNS.items() if name in arrays for column in columns]
    rows = np.hstack([arrays[name].reshape(len(arrays["t"]), -1) for name in COLUMNS if name in arrays])
    path.write_text("\n".join([",".join(names), *(",".join(map(repr, row)) for row in rows.tolist())]) + "\n")
    return path


def without_plan(seconds: float = 16.0) -> dict[str, Array]:
    return {name: array[: round(seconds * RATE)] for name, array in driven().items() if name != "planned"}


def of_point(arrays: dict[str, Array], ahead: float) -> dict[str, Array]:
    """Poses and rates of another point of the cart."""
    heading, turning = arrays["pose"][:, 2], arrays["rates"][:, 2]
    arm, aside = np.zeros((2, len(heading), 3))
    arm[:, 0], arm[:, 1] = ahead * np.cos(heading), ahead * np.sin(heading)
    aside[:, 0], aside[:, 1] = -arm[:, 1] * turning, arm[:, 0] * turning
    return {"pose": arrays["pose"] + arm, "rates": arrays["rates"] + aside}


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".CSV"])
def test_a_cart_is_found_in_a_recording(suffix: str, tmp_path: Path) -> None:
    path, report = tmp_path / f"cart{suffix}", tmp_path / "report.json"
    arrays = driven() if suffix == ".csv" else without_plan()
    if suffix == ".npz":
        np.savez(path, **arrays)
    else:
        write_csv(path, arrays)
    hand = ["--hand", str(HAND[0]), str(HAND[1])]
    assert run_command_line(["cart", "identify", str(path), *hand, "--json", str(report), "--quiet"]) == 0
    found = json.loads(report.read_text())
    truth = dict(zip(found["quantities"], (BODY.mass, *BODY.com, BODY.inertia, *BODY.friction), strict=True))
    for name, quantity in found["quantities"].items():
        assert not quantity["not_known"]
        assert abs(quantity["value"] - truth[name]) < 5.0 * quantity["std"], name
    assert found["changes_s"] == []
    assert found["doubts"] == []


def test_noise_that_is_larger_than_was_said_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_csv(tmp_path / "cart.csv", without_plan(5.0))
    hand = ["--hand", str(HAND[0]), str(HAND[1])]
    assert run_command_line(["cart", "identify", str(path), *hand, "--noise", "0.001"]) == 3
    assert "velocity is 5." in capsys.readouterr().out


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda a: {**a, "pose": a["pose"] * [1.0, 1.0, 180.0 / np.pi]}, "theta were in degrees"),
        (lambda a: {**a, "pose": a["pose"] * [1e3, 1e3, 1.0]}, "x, y were in millimetres"),
        (lambda a: {**a, "pose": 0.0 * a["pose"], "rates": 0.0 * a["rates"]}, "the cart is never faster than 0 m/s"),
        (lambda a: {**a, **{k: a[k] * [0.0, 0.0, 1.0] for k in ("pose", "rates")}}, "the cart is never faster than 0"),
        (lambda a: {**a, "push": -a["push"]}, "turn the signs of fx, fy, mz"),
        (lambda a: {**a, "pose": a["pose"][:, [1, 0, 2]]}, "would fit if x and y, or vx and vy, were exchanged"),
        (lambda a: {**a, "t": 1.1 * a["t"]}, "poses change 0.909 times as much as rates say"),
        (lambda a: {**a, "pose": a["pose"] + [0.0, 0.0, 0.05]}, "theta is off by -2.9°"),
        (lambda a: {**a, **of_point(a, 0.1)}, "m ahead of the axle"),
        (lambda a: {**a, **{name: a[name] * [1.0, 1.0, -1.0] for name in ("pose", "rates")}}, "growing to the left"),
        (lambda a: {**a, "t": 1000.0 * a["t"]}, "in milliseconds"),
        (lambda a: {**a, "t": a["t"][::-1]}, "times must rise, but sample 2"),
        (lambda a: {name: array[:50] for name, array in a.items()}, "found 50 samples"),
        (lambda a: {name: array for name, array in a.items() if name != "rates"}, "column 'vx' is missing"),
        (
            lambda a: {**a, "pose": np.where(np.arange(len(a["t"]))[:, None] == 7, np.nan, a["pose"])},
            "line 9, column 'x': found 'nan'",
        ),
        (
            lambda a: {
                **a,
                "rates": np.array([axes(p[2]).T @ r for p, r in zip(a["pose"], a["rates"], strict=True)]),
            },
            "if rates were in the cart's axes",
        ),
    ],
)
def test_files_of_another_meaning_are_refused_with_what_would_do(
    change: object, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert callable(change)
    path = write_csv(tmp_path / "cart.csv", change(without_plan()))
    hand = ["--hand", str(HAND[0]), str(HAND[1])]
    assert run_command_line(["cart", "identify", str(path), *hand]) == EXIT_ERROR
    assert words in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda push: push[:, [1, 0, 2]], "everything would fit if fx and fy were exchanged"),
        (lambda push: push * [1.0, 1.0, -1.0], "everything would fit if mz had the opposite sign"),
        (lambda push: push * [1.0, 1.0, 1e3], "everything would fit if mz were in N·mm"),
    ],
)
def test_what_fits_with_another_meaning_is_told(
    change: object, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whether the filter survives the wrong meaning does not matter."""
    assert callable(change)
    arrays = without_plan(8.0)
    path = write_csv(tmp_path / "cart.csv", {**arrays, "push": change(arrays["push"])})
    hand = ["--hand", str(HAND[0]), str(HAND[1])]
    assert run_command_line(["cart", "identify", str(path), *hand]) in (EXIT_ERROR, EXIT_NOT_CONVERGED)
    out, err = capsys.readouterr()
    assert words in " ".join(f"{out} {err}".split())
    recording = read_cart_recording(path)
    assert explanation(recording, HAND, lambda *_: False) == ""
    kept = []
    explanation(recording, HAND, lambda thin, _: bool(kept.append(len(thin.times))))
    assert max(kept) == 200


@pytest.mark.slow
def test_where_no_meaning_fits_it_is_said_what_to_check(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The hand is said to be 10 cm beside where it is, which is no common mistake."""
    path = write_csv(tmp_path / "cart.csv", without_plan(5.0))
    hand = ["--hand", str(HAND[0]), str(HAND[1] - 0.1)]
    assert run_command_line(["cart", "identify", str(path), *hand]) == EXIT_NOT_CONVERGED
    out = " ".join(capsys.readouterr().out.split())
    assert "no other meaning that was tried fits: check units (N, N·m, m, rad), axes and signs" in out


@pytest.mark.parametrize("option", [["--hand", "nan", "0"], ["--noise", "inf"]])
def test_numbers_that_are_not_finite_are_refused(
    option: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_csv(tmp_path / "cart.csv", without_plan())
    assert run_command_line(["cart", "identify", str(path), *option]) == EXIT_USAGE
    told = capsys.readouterr().err
    assert f"coheft: {option[0]}: " in told
    assert "finite number" in told


def test_a_cart_that_seems_to_change_all_the_time_is_told_in_short() -> None:
    console = Console(record=True, width=200, file=io.StringIO())
    print_identification(console, CartIdentification(100, 10.0, {}, [0.1 * k for k in range(20)], []))
    assert "changed at about 0.00, 0.10, 0.20, 0.30, 0.40, 0.50, 0.60, 0.70 and 12 times more;" in console.export_text()


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"ends with '.txt', expected a .csv"):
        read_cart_recording(tmp_path / "cart.txt")
    with pytest.raises(RecordingError, match="expected a file"):
        read_cart_recording(tmp_path)
    with pytest.raises(RecordingError, match="cannot be read"):
        read_cart_recording(tmp_path / "none.csv")
    np.savez(tmp_path / "cart.npz", **without_plan(), weight=3.0)
    with pytest.raises(RecordingError, match="key 'weight' is unknown; allowed: t, pose"):
        read_cart_recording(tmp_path / "cart.npz")

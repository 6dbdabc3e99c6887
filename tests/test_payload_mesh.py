"""Surfaces as other programs write them: what is inside is filled exactly, and what has no inside is refused."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

from coheft.errors import ScenarioError
from coheft.estimation.geometry.spatial import Pose, rotation_exp
from coheft.estimation.rigid_body.mass_properties import Inertia, combined
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.payload_mesh import filled, read_triangles

EDGES = [0.4, 0.2, 0.1]


def box(*middle: float, edges: list[float] | None = None, inside_out: bool = False) -> np.ndarray:
    surface = trimesh.creation.box(extents=edges or EDGES)
    surface.apply_translation(middle)
    if inside_out:
        surface.invert()
    return np.array(surface.triangles)


def as_boxes(*middles: tuple[float, float, float]) -> Inertia:
    return combined(Inertia.of_box(4.0, EDGES, Pose(np.eye(3), np.array(middle))) for middle in middles)


def assert_same(one: Inertia, other: Inertia, tolerance: float = 1e-9) -> None:
    np.testing.assert_allclose(one.barycentric(), other.barycentric(), atol=tolerance)


@pytest.mark.parametrize(
    "middle",
    [(0.0, 0.2, 0.1), (0.4, 0.2, 0.1), (0.4, 0.0, 0.0), (1.0, 0.0, 0.0), (0.2, 0.2, 0.1)],
    ids=["share an edge", "share a corner", "share a face", "are apart", "share half an edge"],
)
def test_shells_may_touch(middle: tuple[float, float, float], caplog: pytest.LogCaptureFixture) -> None:
    surface = np.concatenate([box(0.0, 0.0, 0.0), box(*middle)])
    assert_same(filled(surface, None, 500.0, "x"), as_boxes((0.0, 0.0, 0.0), middle))
    assert caplog.text == ""


def test_vertices_are_the_same_if_a_file_rounds_them() -> None:
    surface = box(0.0, 0.0, 0.0) + 1e-8 * np.random.default_rng(1).standard_normal((12, 3, 3))
    assert_same(filled(surface, None, 500.0, "x"), as_boxes((0.0, 0.0, 0.0)), 1e-6)


def test_the_frame_does_not_matter() -> None:
    surface = np.concatenate([box(0.0, 0.0, 0.0), box(0.3, 0.2, 0.1)])
    pose = Pose(rotation_exp(np.array([0.4, -1.0, 2.0])), np.array([30.0, -20.0, 10.0]))
    moved = surface @ pose.rotation.T + pose.translation
    assert_same(filled(moved, 8.0, None, "x"), filled(surface, 8.0, None, "x").transported(pose), 1e-7)


def test_a_cavity_is_empty_and_what_lies_in_it_is_not(caplog: pytest.LogCaptureFixture) -> None:
    cavity = box(0.0, 0.0, 0.0, edges=[0.3, 0.1, 0.05], inside_out=True)
    nut = box(0.0, 0.0, 0.0, edges=[0.2, 0.05, 0.02])
    surface = np.concatenate([box(0.0, 0.0, 0.0), cavity, nut])
    assert filled(surface, None, 1000.0, "x").mass == pytest.approx(8.0 - 1.5 + 0.2)
    assert caplog.text == ""


def test_shells_that_overlap_are_remarked(caplog: pytest.LogCaptureFixture) -> None:
    surface = np.concatenate([box(0.0, 0.0, 0.0), box(0.2, 0.0, 0.0, edges=[0.2, 0.2, 0.2])])
    assert filled(surface, None, 500.0, "key 'payload.mesh'").mass == pytest.approx(8.0)
    assert "key 'payload.mesh': shells of its surface overlap, around (0.15" in caplog.text
    assert "about 12.5% of its volume is counted twice" in caplog.text
    assert "turn the inner one inside out if it is a cavity" in caplog.text


def test_what_lies_in_three_shells_counts_two_times_too_often(caplog: pytest.LogCaptureFixture) -> None:
    surface = np.concatenate([box(at, 0.0, 0.0, edges=[0.4, 0.2, 0.1]) for at in (0.0, 0.1, 0.2)])
    filled(surface, None, 500.0, "x")
    found = re.search(r"about (.*)% of its volume is counted twice", caplog.text)
    assert found is not None
    assert float(found[1]) == pytest.approx(50.0, abs=3.0)  # 12 kg where the union has 6 kg


def test_shells_that_hardly_overlap_are_not_remarked(caplog: pytest.LogCaptureFixture) -> None:
    surface = np.concatenate([box(at, 0.0, 0.0, edges=[0.4, 0.2, 0.1]) for at in (0.0, 0.3999)])
    filled(surface, None, 500.0, "x")
    assert caplog.text == ""


@pytest.mark.parametrize("far", [0.0, 0.5], ids=["alone", "beside another shell"])
def test_shells_inside_out_are_refused(far: float) -> None:
    surface = box(far, 0.0, 0.0, inside_out=True)
    if far:
        surface = np.concatenate([box(0.0, 0.0, 0.0), surface])
    with pytest.raises(
        ScenarioError, match=r"around \(0.5, 0, 0\) m, is inside out" if far else "its surface is inside"
    ):
        filled(surface, 1.0, None, "x")


@pytest.mark.parametrize("rest", [[], [(1.0, 0.0, 0.0)]], ids=["alone", "beside another shell"])
def test_copies_of_a_shell_are_refused(rest: list[tuple[float, float, float]]) -> None:
    surface = np.concatenate([box(0.0, 0.0, 0.0), *(box(*middle) for middle in rest), box(0.0, 0.0, 0.0)])
    with pytest.raises(ScenarioError, match=f"12 of its {len(surface)} triangles are copies of others"):
        filled(surface, None, 500.0, "x")


def test_triangles_that_do_not_agree_are_refused() -> None:
    surface = box(0.0, 0.0, 0.0)
    surface[0] = surface[0, ::-1]
    with pytest.raises(ScenarioError, match="its triangles do not agree where outside is, at 3 edges"):
        filled(surface, 1.0, None, "x")


def test_a_surface_without_extent_is_refused() -> None:
    flat = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0], [0, 1, 0], [1, 0, 0]]], dtype=np.float64)
    with pytest.raises(ScenarioError, match="it encloses 0 m³, which has no extent"):
        filled(flat, 1.0, None, "x")


@pytest.mark.parametrize("name", ["part.stl", "part.STL", "ascii.stl", "part.obj", "part.ply"])
def test_formats(name: str, tmp_path: Path) -> None:
    surface = trimesh.creation.box(extents=EDGES)
    path = tmp_path / name
    kind = "stl_ascii" if name == "ascii.stl" else path.suffix[1:].lower()
    surface.export(path, file_type=kind)
    np.testing.assert_allclose(read_triangles(path), surface.triangles, atol=1e-7)


@pytest.mark.parametrize("name", ["part.stl", "part.obj", "part.ply", "part.msh", "part.step", "part"])
def test_files_that_are_none_are_refused(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("hello\n")
    (tmp_path / "mine.toml").write_text(
        f'name = "mine"\npayload = {{ mesh = "{name}", mass = 1.0 }}\n'
        "robots.grasps = [{ position = [0.1, 0, 0] }, { position = [-0.1, 0, 0] }]\n"
    )
    with pytest.raises(ScenarioError, match=re.escape(f"key 'payload.mesh': {tmp_path / name}: ") + ".*: is it whole"):
        load_scenario(tmp_path / "mine.toml")

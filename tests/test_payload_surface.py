"""What a payload from a file looks like: triangles for views."""

from __future__ import annotations

import base64
from pathlib import Path

import numpy as np
import pytest
import trimesh

from coheft.errors import ScenarioError
from coheft.physics_server.simulation import Simulation
from coheft.wire.scenario.file import load_scenario, parse_scenario
from coheft.wire.scenario.payload_surface import MOST, coarse, from_text, to_text

SCENARIO = """
name = "own"
[payload]
{payload}
[robots]
grasps = [{{ position = [0.3, 0, 0] }}, {{ position = [-0.3, 0, 0] }}]
"""


def volume(triangles: np.ndarray) -> float:
    return abs(float(np.linalg.det(triangles).sum() / 6.0))


def shown(payload: str, folder: Path) -> np.ndarray:
    """Triangles that the server tells observers of."""
    scenario = parse_scenario(SCENARIO.format(payload=payload), "own", folder)
    return Simulation(scenario).scene.triangles


def test_shapes_enclose_what_they_should(tmp_path: Path) -> None:
    shapes = {
        'type="box" size="0.1 0.2 0.3"': 8 * 0.1 * 0.2 * 0.3,
        'type="cylinder" size="0.1 0.3"': np.pi * 0.1**2 * 0.6,
        'type="capsule" size="0.1 0.3"': np.pi * 0.1**2 * 0.6 + 4.0 / 3.0 * np.pi * 0.1**3,
        'type="ellipsoid" size="0.1 0.2 0.3"': 4.0 / 3.0 * np.pi * 0.1 * 0.2 * 0.3,
    }
    for shape, expected in shapes.items():
        (tmp_path / "own.xml").write_text(f"<mujoco><worldbody><body><geom {shape}/></body></worldbody></mujoco>")
        triangles = shown('mjcf = "own.xml"', tmp_path)
        assert volume(triangles) == pytest.approx(expected, rel=0.1)
        low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
        np.testing.assert_allclose(low, -high, atol=1e-6)


def test_a_fine_surface_becomes_coarse_and_keeps_its_shape() -> None:
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.4).triangles
    assert len(ball) > 10 * MOST
    few = coarse(ball)
    assert MOST / 6 < len(few) <= MOST
    np.testing.assert_allclose(np.linalg.norm(few.reshape(-1, 3), axis=1), 0.4, rtol=0.05)
    assert coarse(ball[:MOST]) is not few
    np.testing.assert_array_equal(coarse(ball[:MOST]), ball[:MOST])


def test_a_mesh_is_told_as_it_is_in_metres(tmp_path: Path) -> None:
    mesh = trimesh.creation.box((600.0, 400.0, 100.0))
    mesh.apply_translation([50.0, 0.0, 0.0])
    mesh.export(tmp_path / "own.stl")
    triangles = shown('mesh = "own.stl"\nmass = 5.0\nscale = 0.001', tmp_path)
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    np.testing.assert_allclose([low, high], [[-0.25, -0.2, -0.05], [0.35, 0.2, 0.05]], atol=1e-6)


def test_a_model_is_told_with_all_of_its_shapes(tmp_path: Path) -> None:
    (tmp_path / "own.xml").write_text("""
        <mujoco><worldbody><body name="own"><freejoint/>
          <geom type="box" size="0.3 0.2 0.01"/>
          <body pos="0 0 0.1"><geom type="sphere" size="0.05"/></body>
        </body></worldbody></mujoco>""")
    triangles = shown('mjcf = "own.xml"', tmp_path)
    assert triangles.max(axis=(0, 1)) == pytest.approx([0.3, 0.2, 0.15], abs=1e-3)
    assert triangles.min(axis=(0, 1)) == pytest.approx([-0.3, -0.2, -0.01], abs=1e-3)


def test_the_crate_is_shown() -> None:
    triangles = Simulation(load_scenario("crate4")).scene.triangles
    assert 5 * 12 < len(triangles) <= MOST
    assert triangles.max(axis=(0, 1))[0] == pytest.approx(0.3, abs=1e-6)


def test_text_that_is_no_surface_is_refused() -> None:
    box = trimesh.creation.box((2.0, 2.0, 2.0)).triangles
    np.testing.assert_allclose(from_text(to_text(box)), box)
    for text in ("no", "AAAA", to_text(np.full((1, 3, 3), np.nan))):
        with pytest.raises(ScenarioError, match=r"payload.surface.*leave it out"):
            load_scenario("ring3", [f"payload.surface='{text}'"])


def test_more_triangles_than_messages_have_room_for_are_refused() -> None:
    text = base64.b64encode(bytes(36 * (MOST + 1))).decode()
    with pytest.raises(ScenarioError, match=r"payload.surface': it holds 1501 triangles, more than the 1500"):
        load_scenario("ring3", [f"payload.surface='{text}'"])

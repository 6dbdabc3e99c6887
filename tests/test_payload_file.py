"""Payloads from files: what MuJoCo says of them is what is simulated, and what cannot be carried is refused."""

from __future__ import annotations

import struct
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from coheft.errors import ScenarioError
from coheft.estimation.geometry.spatial import Pose
from coheft.physics_server.simulation import Simulation
from coheft.wire.scenario.file import CONFIG_FOLDER, load_scenario, parse_scenario
from coheft.wire.scenario.schema import Scenario

GRASPS = "grasps = [{ position = [-0.2, 0, 0] }, { position = [0.2, 0, 0] }]"
BODY = '<body name="part" pos="1 2 3" euler="10 20 30"><geom type="box" size="0.2 0.1 0.05" mass="4"/>{}</body>'
CORNERS = np.array([[x, y, z] for x in (0, 100) for y in (0, 200) for z in (0, 300)], dtype=np.float64)  # mm
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
TRIANGLES = [corners for a, b, c, d in SIDES for corners in ((a, b, c), (a, c, d))]


def write_stl(path: Path, triangles: list[tuple[int, ...]]) -> None:
    facets = [struct.pack("<12fH", 0, 0, 0, *CORNERS[list(corners)].ravel(), 0) for corners in triangles]
    path.write_bytes(bytes(80) + struct.pack("<I", len(facets)) + b"".join(facets))


def write_obj(path: Path, triangles: list[tuple[int, ...]]) -> None:
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS]
    path.write_text("\n".join(lines + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles]) + "\n")


def load(folder: Path, payload: str, robots: str = GRASPS) -> Scenario:
    path = folder / "mine.toml"
    path.write_text(f'name = "mine"\nduration = 1.0\n[payload]\n{payload}\n[robots]\n{robots}\n')
    return load_scenario(path)


def model_file(folder: Path, bodies: str) -> None:
    (folder / "part.xml").write_text(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")


def mass_matrix(model: mujoco.MjModel) -> np.ndarray:
    """Of the free body of a model, turned and shifted anyhow, (6, 6)."""
    data = mujoco.MjData(model)
    data.qpos[:7] = 0.3, -0.2, 0.5, 0.5, 0.5, -0.5, 0.5
    mujoco.mj_forward(model, data)
    matrix = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, matrix)
    return matrix


def test_a_model_is_simulated_as_its_author_would() -> None:
    simulation = Simulation(load_scenario("crate4"))
    theirs = mujoco.MjModel.from_xml_path(str(CONFIG_FOLDER / "crate.xml"))
    np.testing.assert_allclose(mass_matrix(simulation.model), mass_matrix(theirs), rtol=1e-12, atol=1e-12)


def test_sites_are_grasp_frames_as_they_are_oriented() -> None:
    shipped = load_scenario("crate4")
    model = mujoco.MjModel.from_xml_path(str(CONFIG_FOLDER / "crate.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    body = Pose(data.body("crate").xmat.reshape(3, 3), data.body("crate").xpos)
    names = ("handle_left", "rim_front", "handle_right", "rim_back")
    for grasp, name in zip(shipped.robots.poses(), names, strict=True):
        in_world = body @ grasp
        np.testing.assert_allclose(in_world.rotation, data.site(name).xmat.reshape(3, 3), atol=1e-12)
        np.testing.assert_allclose(in_world.translation, data.site(name).xpos, atol=1e-12)


def test_loads_lie_on_a_payload_from_a_file() -> None:
    simulation = Simulation(load_scenario("crate4"))
    before = simulation.advance({}).truth.payload.mass
    simulation.inject(3.0, (0.1, 0.0, 0.1))
    assert simulation.advance({}).truth.payload.mass == pytest.approx(before + 3.0)


def test_bodies_that_are_fixed_inside_belong_to_the_payload_wherever_it_stands(tmp_path: Path) -> None:
    lid = '<body name="lid" pos="0 0 0.1" euler="0 0 90"><geom type="sphere" size="0.05" pos="0.2 0 0" mass="1"/>'
    lid += '<site name="top" pos="0.1 0 0"/></body><site name="side" pos="0.2 0 0" euler="0 90 0"/>'
    model_file(tmp_path, BODY.format(lid))
    scenario = load(tmp_path, 'mjcf = "part.xml"', 'sites = ["side", "top"]')
    inertia = scenario.payload.inertia()
    assert inertia.mass == pytest.approx(5.0)
    np.testing.assert_allclose(inertia.com, np.array([0.0, 0.2, 0.1]) / 5.0, atol=1e-12)
    side, top = scenario.robots.poses()
    np.testing.assert_allclose(top.translation, [0.0, 0.1, 0.1], atol=1e-12)
    np.testing.assert_allclose(top.rotation[:, 0], [0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(side.rotation[:, 2], [1.0, 0.0, 0.0], atol=1e-12)


def test_one_of_several_bodies_is_named(tmp_path: Path) -> None:
    model_file(tmp_path, BODY.format("") + '<body name="other"><geom size="0.1" mass="7"/></body>')
    assert load(tmp_path, 'mjcf = "part.xml"\nbody = "other"').payload.inertia().mass == pytest.approx(7.0)
    assert load(tmp_path, 'mjcf = "part.xml"\nbody = "part"').payload.inertia().mass == pytest.approx(4.0)


@pytest.mark.parametrize("write", [write_stl, write_obj])
@pytest.mark.parametrize("amount", ["mass = 6.0", "density = 1000.0"])
def test_a_mesh_is_filled_homogeneously(write, amount: str, tmp_path: Path) -> None:
    path = tmp_path / f"part.{write.__name__[-3:]}"
    write(path, TRIANGLES)
    inertia = load(tmp_path, f'mesh = "{path.name}"\nscale = 0.001\n{amount}').payload.inertia()
    assert inertia.mass == pytest.approx(6.0)
    np.testing.assert_allclose(inertia.com, [0.05, 0.1, 0.15], rtol=1e-6)
    np.testing.assert_allclose(inertia.tensor, np.diag([0.065, 0.05, 0.025]), atol=1e-7)


@pytest.mark.parametrize(
    ("bodies", "robots", "expected"),
    [
        ('<geom size="0.1"/>', GRASPS, "the model has no body: expected what is held inside of a <body>"),
        (
            BODY.format("") + '<body name="other"><geom size="0.1"/></body>',
            GRASPS,
            "key 'payload.body': it is missing, but the model has several: part, other",
        ),
        (
            BODY.format('<body name="door"><joint name="hinge"/><geom size="0.1"/></body>'),
            GRASPS,
            "body 'part' has a joint (hinge, hinge): expected one rigid body",
        ),
        (BODY.replace('mass="4"', 'mass="0"').format(""), GRASPS, "body 'part' has no mass"),
        ('<body name="a"><inertial mass="1" pos="0 0 0" diaginertia="1 1 2"/></body>', GRASPS, "has no extent"),
        ('<body name="a"><geom typ="box"/></body>', GRASPS, "MuJoCo cannot use it: XML Error"),
        (
            BODY.format('<site name="grip1"/>'),
            'sites = ["grip1", "grip1"]',
            "found 'grip1' twice, but expected a site of its own for each robot",
        ),
        (
            BODY.format('<site name="grip1"/>'),
            'sites = ["grip1", "grip2"]',
            "found 'grip2', but body 'part' has no such site; it has: grip1",
        ),
        (
            BODY.format('<site name="grip1"/><site pos="0.1 0 0"/>'),
            'sites = ["grip1", ""]',
            "found '', but body 'part' has no such site; it has: grip1",
        ),
        (
            BODY.format("") + '<site name="grip1"/>',
            'sites = ["grip1"]',
            "no such site, but 'world', which is not held; it has: none",
        ),
        (
            '<body name="a"><geom type="box" size="inf 1 1" mass="2"/></body>',
            GRASPS,
            "body 'a' has infinite mass properties",
        ),
        (
            BODY.format('<site name="grip1"/>'),
            'sites = ["grip1"]',
            "key 'robots.sites': found 'grip1' alone, expected at least 2: each robot grasps one",
        ),
    ],
)
def test_models_that_cannot_be_carried(bodies: str, robots: str, expected: str, tmp_path: Path) -> None:
    model_file(tmp_path, bodies)
    with pytest.raises(ScenarioError) as error:
        load(tmp_path, 'mjcf = "part.xml"', robots)
    assert str(error.value).startswith(f"{tmp_path / 'mine.toml'}: key '")
    assert expected in str(error.value)


@pytest.mark.parametrize(
    ("payload", "expected"),
    [
        ('mjcf = "none.xml"', "none.xml cannot be read: No such file or directory; paths are relative to"),
        ('mesh = "none.stl"\nmass = 1.0', "none.stl cannot be read: No such file"),
        ('mjcf = "a\\u0000"', "no file can have this name"),
        ('mjcf = "."', "cannot be read: Is a directory"),
        (
            'mesh = "open.stl"\nscale = 0.001\nmass = 1.0',
            "its surface is not closed: 3 edges have a triangle on one side only",
        ),
        ('mesh = "turned.stl"\nscale = 0.001\nmass = 1.0', "its surface is inside out"),
        ('mesh = "closed.stl"', "neither 'mass' nor 'density'"),
        ('mesh = "closed.stl"\nmass = 1.0\ndensity = 1.0', "both 'mass' and 'density'"),
        ('mesh = "closed.stl"\nmjcf = "part.xml"\nmass = 1.0', "both 'mjcf' and 'mesh'"),
        ('mesh = "closed.stl"\nmass = 1.0\nbody = "part"', "found it without 'payload.mjcf'"),
        ('mjcf = "part.xml"\nscale = 0.1', "found it without 'payload.mesh'"),
        ('mesh = "closed.stl"\nmass = inf', "expected a finite number"),
        ('mjcf = "part.xml"\nbody = "hat"', "found 'hat', but there is no such body; there are: part"),
    ],
)
def test_files_that_cannot_be_used(payload: str, expected: str, tmp_path: Path) -> None:
    model_file(tmp_path, BODY.format(""))
    write_stl(tmp_path / "closed.stl", TRIANGLES)
    write_stl(tmp_path / "open.stl", TRIANGLES[1:])
    write_stl(tmp_path / "turned.stl", [corners[::-1] for corners in TRIANGLES])
    with pytest.raises(ScenarioError) as error:
        load(tmp_path, payload)
    assert expected in str(error.value)


def test_a_mesh_in_millimetres_without_its_scale_is_refused(tmp_path: Path) -> None:
    write_stl(tmp_path / "part.stl", TRIANGLES)
    for scale in ("", "scale = 0.1\n"):
        with pytest.raises(ScenarioError) as error:
            load(tmp_path, f'mesh = "part.stl"\n{scale}mass = 6.0')
        length = 300 if not scale else 30
        assert f"key 'payload.mesh': the mesh is {length} m long, expected at most 20 m: if it is" in str(error.value)
        assert str(error.value).endswith("drawn in millimetres, set 'payload.scale' = 0.001")


@pytest.mark.parametrize(
    ("amount", "words"),
    [
        ("scale = 0.0254\nmass = 6.0", "kg/m³, expected 0.5 to 23000: 'payload.scale' is the length of its unit"),
        ("scale = 0.001\ndensity = 2.7", "of 2.7 kg/m³, expected 10 to 23000: .* densities in kg/m³"),
        ("scale = 0.001\nmass = 6000.0", "kg/m³, expected 0.5 to 23000: .* masses are in kg"),
    ],
)
def test_meshes_that_would_be_lighter_than_air_or_denser_than_gold_are_refused(
    amount: str, words: str, tmp_path: Path
) -> None:
    write_stl(tmp_path / "part.stl", TRIANGLES)
    with pytest.raises(ScenarioError, match=words):
        load(tmp_path, f'mesh = "part.stl"\n{amount}')


def test_a_model_in_millimetres_is_refused(tmp_path: Path) -> None:
    model_file(tmp_path, '<body name="part"><geom type="box" size="200 100 50" mass="4"/></body>')
    with pytest.raises(ScenarioError, match=r"'payload.mjcf': the body is 400 m long, .* are in metres"):
        load(tmp_path, 'mjcf = "part.xml"')


@pytest.mark.parametrize("x", [0.65, 3.2, 200.0])
def test_hands_far_from_a_payload_from_a_file_are_named(x: float, tmp_path: Path) -> None:
    write_stl(tmp_path / "part.stl", TRIANGLES)
    grasps = f"grasps = [{{ position = [0, 0, 0] }}, {{ position = [{x}, 0, 0] }}]"
    with pytest.raises(ScenarioError) as error:
        load(tmp_path, 'mesh = "part.stl"\nscale = 0.001\nmass = 6.0', grasps)
    outside = (
        f"{x - 0.1:.3g} m outside the payload, which is 0.3 m long; expected at most 0.3 m: positions are in metres"
    )
    assert f"key 'robots.grasps[1].position': found [{x}, 0.0, 0.0], which is {outside}" in str(error.value)
    site = f'<site name="near"/><site name="far" pos="{x} 0 0"/>'
    model_file(tmp_path, BODY.format(site).replace('size="0.2', 'size="0.1').replace('0.1 0.05"', '0.02 0.05"'))
    with pytest.raises(
        ScenarioError, match=r"key 'robots.sites': site 'far' is .* m outside the payload, which is 0.2 m"
    ):
        load(tmp_path, 'mjcf = "part.xml"', 'sites = ["near", "far"]')


def test_sites_need_a_model() -> None:
    text = 'name = "x"\npayload.boxes = [{ mass = 1, size = [1, 1, 1] }]\nrobots.sites = ["a", "b"]'
    with pytest.raises(ScenarioError, match=r"'robots.sites': found a, b, but only a model has sites"):
        parse_scenario(text, "x.toml")


def test_agents_and_estimation_do_not_load_mujoco() -> None:
    code = "import sys, coheft.agents.process.main, coheft.estimation.bounds; sys.exit('mujoco' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=CONFIG_FOLDER.parent, check=False).returncode == 0

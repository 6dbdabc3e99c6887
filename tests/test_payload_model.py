"""Models as other people write them: floating bases, bodies without names, pictures that are missing, mere looks."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh

from coheft.errors import ScenarioError
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.payload_surface import from_text
from coheft.wire.scenario.schema import Scenario

GRASPS = "robots.grasps = [{ position = [0.1, 0, 0] }, { position = [-0.1, 0, 0] }]"
PLATE = '<geom type="box" size=".4 .2 .05" density="400"/>'
PLATE_MASS = 12.8
LINK = """<link name="beam"><inertial><origin xyz="0 0 0" rpy="0 0 1.57079632679"/><mass value="6.0"/>
<inertia ixx="0.10" ixy="0" ixz="0" iyy="0.50" iyz="0" izz="0.55"/></inertial>
<collision><geometry><box size="0.2 1.0 0.1"/></geometry></collision></link>"""


def load(folder: Path, model: str, name: str = "part.xml", more: str = "") -> Scenario:
    (folder / name).write_text(model)
    path = folder / "mine.toml"
    path.write_text(f'name = "mine"\npayload.mjcf = "{name}"\n{more}\n{GRASPS}\n')
    return load_scenario(path)


def world(inside: str) -> str:
    return f"<mujoco><worldbody>{inside}</worldbody></mujoco>"


@pytest.mark.parametrize(
    "above", ["", '<inertial><mass value="9"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>']
)
def test_a_floating_joint_of_a_urdf_is_the_payloads_own(above: str, tmp_path: Path) -> None:
    """What MuJoCo makes of the file itself is what is held, in the frame of the link that floats."""
    urdf = (
        f'<robot name="r"><link name="stand">{above}</link><joint name="free" type="floating"><parent link="stand"/>'
        f'<child link="beam"/><origin xyz="0 0 1"/></joint>{LINK}</robot>'
    )
    inertia = load(tmp_path, urdf, "part.urdf").payload.inertia()
    theirs = mujoco.MjModel.from_xml_path(str(tmp_path / "part.urdf"))
    assert inertia.mass == pytest.approx(theirs.body_mass[1]) == pytest.approx(6.0)
    np.testing.assert_allclose(inertia.com, 0.0, atol=1e-12)
    np.testing.assert_allclose(inertia.tensor, np.diag([0.50, 0.10, 0.55]), atol=1e-9)
    with pytest.raises(ScenarioError, match="body 'stand' has a free joint, of 'beam' below it"):
        load(tmp_path, urdf, "part.urdf", 'payload.body = "stand"')


def test_what_floats_is_held_and_not_the_table(tmp_path: Path) -> None:
    table = '<body pos="3 0 0"><geom type="box" size="1 1 .4"/></body>'
    model = world(f'{table}<body pos="0 0 1"><freejoint/>{PLATE}</body>')
    assert load(tmp_path, model).payload.inertia().mass == pytest.approx(PLATE_MASS)


@pytest.mark.parametrize(("joint", "aligns"), [('align="true"', "false"), ("", "true")])
def test_what_floats_keeps_its_own_frame(joint: str, aligns: str, tmp_path: Path) -> None:
    shape = PLATE.replace("size", 'pos=".3 0 .1" size')
    model = world(f'<body name="b"><freejoint {joint}/>{shape}</body>')
    model = model.replace("<mujoco>", f'<mujoco><compiler alignfree="{aligns}"/>')
    np.testing.assert_allclose(load(tmp_path, model).payload.inertia().com, [0.3, 0.0, 0.1])


def test_shapes_without_bounds_do_not_count(tmp_path: Path) -> None:
    scenario = load(tmp_path, world(f'<body>{PLATE}<geom type="plane" size="1 1 1"/></body>'))
    assert scenario.payload.inertia().mass == pytest.approx(PLATE_MASS)
    assert np.abs(from_text(scenario.payload.surface)).max() == pytest.approx(0.4)


def test_bodies_without_names_can_be_named(tmp_path: Path) -> None:
    model = world(f'<body pos="3 0 0">{PLATE}</body><body name="other">{PLATE}</body><body><geom size="0.1"/></body>')
    with pytest.raises(ScenarioError, match=r"the model has several: body 1, other, body 3$"):
        load(tmp_path, model)
    assert load(tmp_path, model, more='payload.body = "body 1"').payload.inertia().mass == pytest.approx(PLATE_MASS)
    clash = model.replace('"other"', '"body 1"')
    assert load(tmp_path, clash, more='payload.body = "body 1_"').payload.inertia().mass == pytest.approx(PLATE_MASS)


@pytest.mark.parametrize(
    "texture",
    [
        '<texture name="t" type="2d" file="wood.png"/>',
        '<texture name="t" type="cube" file="wood.png" gridsize="3 4" gridlayout=".U..LFRB.D.."/>',
        '<texture name="t" type="skybox" fileright="a.png" fileleft="b.png"/>',
        '<texture type="skybox" builtin="gradient" width="8" height="48"/><texture name="t" type="2d" file="w.png"/>',
    ],
)
def test_pictures_may_be_missing(texture: str, tmp_path: Path) -> None:
    assets = f'<asset>{texture}<material name="m" texture="t"/></asset>'
    plate = PLATE.replace("/>", ' material="m"/>')
    model = world(f'<body name="b">{plate}</body>').replace("<mujoco>", f"<mujoco>{assets}")
    assert load(tmp_path, model).payload.inertia().mass == pytest.approx(PLATE_MASS)


@pytest.mark.parametrize(
    "driven",
    [
        '<keyframe><key name="home" qpos="0 0 1 1 0 0 0"/></keyframe>',
        '<actuator><motor joint="free" gear="0 0 1 0 0 0"/></actuator>',
        '<sensor><framepos objtype="body" objname="b"/></sensor>',
        '<sensor><framepos name="s" objtype="body" objname="b"/></sensor><custom><tuple name="t">'
        '<element objtype="sensor" objname="s"/></tuple></custom>',
    ],
)
def test_what_drives_or_measures_a_floating_body_does_not_matter(driven: str, tmp_path: Path) -> None:
    """MuJoCo itself loads these models, in which the free joint is below a body that is fixed to the world."""
    model = world(f'<body name="stand"><body name="b"><freejoint name="free"/>{PLATE}</body></body>')
    model = model.replace("<mujoco>", '<mujoco><compiler fusestatic="true"/>').replace(
        "</mujoco>", f"{driven}</mujoco>"
    )
    assert mujoco.MjModel.from_xml_string(model).nbody == 2
    assert load(tmp_path, model).payload.inertia().mass == pytest.approx(PLATE_MASS)


def test_mujocos_warnings_are_lines_of_ours(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    child = world(f'<body name="box">{PLATE}</body>').replace("<mujoco>", '<mujoco><option timestep="0.005"/>')
    (tmp_path / "child.xml").write_text(child)
    model = world('<body name="b"><geom size=".1"/><attach model="c" prefix="a_"/></body>').replace(
        "<mujoco>", '<mujoco><asset><model name="c" file="child.xml"/></asset>'
    )
    load(tmp_path, model)
    assert f"{tmp_path / 'part.xml'}: MuJoCo warns: Attach conflict when attaching 'c'" in caplog.text
    assert list(elsewhere.iterdir()) == []


@pytest.mark.parametrize("compiler", ["", '<compiler discardvisual="true"/>'])
def test_shapes_for_their_looks_are_remarked(compiler: str, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """MuJoCo counts their mass even if it discards them."""
    looks = PLATE.replace("400", "200").replace("/>", ' contype="0" conaffinity="0"/>')
    model = world(f'<body name="b"><freejoint/>{PLATE}{looks}</body>').replace("<mujoco>", f"<mujoco>{compiler}")
    scenario = load(tmp_path, model)
    assert scenario.payload.inertia().mass == pytest.approx(1.5 * PLATE_MASS)
    assert "6.4 kg of 19.2 kg, 33%, are of shapes that collide with nothing" in caplog.text


def test_looks_in_a_body_of_their_own_are_remarked(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    looks = PLATE.replace("400", "200").replace("/>", ' contype="0" conaffinity="0"/>')
    load(tmp_path, world(f'<body name="b"><freejoint/>{PLATE}<body name="looks">{looks}</body></body>'))
    assert "6.4 kg of 19.2 kg, 33%, are of shapes that collide with nothing" in caplog.text


def test_shapes_that_overlap_are_remarked(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    def beside(attribute: str) -> str:
        return world(f'<body name="b"><freejoint/>{PLATE}{PLATE.replace("/>", f" {attribute}/>")}</body>')

    assert load(tmp_path, beside('group="3"')).payload.inertia().mass == pytest.approx(2.0 * PLATE_MASS)
    assert "shapes overlap" in caplog.text
    assert "about 50.0% of their volume is counted twice" in caplog.text
    caplog.clear()
    load(tmp_path, beside('group="3"').replace("<mujoco>", '<mujoco><compiler inertiagrouprange="3 3"/>'))
    load(tmp_path, beside('pos=".8 0 0"'))
    assert caplog.text == ""


@pytest.mark.parametrize("ends", ['body1="b" body2="tool"', 'site1="on tool" site2="on b"'])
def test_bodies_that_are_welded_to_it_are_remarked(ends: str, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    tool, held = (f'<freejoint/>{PLATE}<site name="on {name}"/>' for name in ("tool", "b"))
    bodies = world(f'<body name="tool" pos="0 0 .1">{tool}</body><body name="b">{held}</body>')
    model = bodies.replace("</mujoco>", f"<equality><weld {ends}/></equality></mujoco>")
    scenario = load(tmp_path, model, more='payload.body = "b"')
    assert scenario.payload.inertia().mass == pytest.approx(PLATE_MASS)
    assert "an equality constraint welds tool to it, which is left out" in caplog.text
    caplog.clear()
    load(tmp_path, model.replace(f"weld {ends}", f'weld active="false" {ends}'), more='payload.body = "b"')
    load(tmp_path, model.replace(ends, 'body1="b"'), more='payload.body = "b"')  # to the world
    hinge = model.replace(f"weld {ends}", 'connect body1="b" body2="tool" anchor="0 0 0"')
    load(tmp_path, hinge, more='payload.body = "b"')
    assert caplog.text == ""


@pytest.mark.parametrize(
    ("other", "ends"),
    [
        ('<body name="hand" mocap="true"><site name="s"/></body>', 'body1="hand" body2="b"'),
        ('<body name="table"><geom size="1"/></body>', 'body1="b" body2="table"'),
        ('<body name="c"><freejoint/><geom size="1"/><body name="d"/></body>', 'body1="c" body2="d"'),
    ],
    ids=["mocap", "static", "others"],
)
def test_welds_that_hold_nothing_else_are_not_remarked(
    other: str, ends: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    bodies = world(f'{other}<body name="b"><freejoint/>{PLATE}</body>')
    model = bodies.replace("</mujoco>", f"<equality><weld {ends}/></equality></mujoco>")
    load(tmp_path, model, more='payload.body = "b"')
    assert caplog.text == ""


@pytest.mark.parametrize(
    ("faces", "words"),
    [(slice(1, None), "its surface is not closed: 3 edges"), (slice(None, None, -1), "its surface is inside out")],
)
def test_meshes_without_an_inside_are_remarked(
    faces: slice, words: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    box = trimesh.creation.box((0.4, 0.3, 0.2))
    corners = box.faces[faces] if faces.step is None else box.faces[:, ::-1]
    trimesh.Trimesh(box.vertices, corners, process=False).export(tmp_path / "box.obj")
    body = world('<body name="b"><freejoint/><geom type="mesh" mesh="box" density="500"/></body>')
    load(tmp_path, body.replace("<mujoco>", '<mujoco><asset><mesh name="box" file="box.obj"/></asset>'))
    assert f"mesh 'box': {words}" in caplog.text
    assert "MuJoCo fills it all the same" in caplog.text


def test_a_body_that_collides_with_nothing_is_not_remarked(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    looks = PLATE.replace("/>", ' contype="0" conaffinity="0"/>')
    load(tmp_path, world(f'<body name="b"><freejoint/>{looks}</body>'))
    assert caplog.text == ""


@pytest.mark.parametrize(
    "other",
    [
        '<geom type="sphere" size="0.1"/>',
        '<geom type="sphere" size="0.1" contype="0" conaffinity="0"/>',
        '<inertial mass="1" pos="0 0 0" diaginertia="1 1 5"/>',
    ],
    ids=["default density", "looks", "impossible inertia"],
)
def test_another_body_that_moves_is_not_remarked(other: str, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    model = world(f'<body name="o" pos="3 0 0"><freejoint/>{other}</body><body name="b"><freejoint/>{PLATE}</body>')
    model = model.replace("<mujoco>", '<mujoco><compiler balanceinertia="true"/>')
    scenario = load(tmp_path, model, more='payload.body = "b"')
    assert scenario.payload.inertia().mass == pytest.approx(PLATE_MASS)
    assert caplog.text == ""


@pytest.mark.parametrize("inertia", ["", ' inertia="exact"'])
def test_meshes_that_are_not_filled_exactly_are_remarked(
    inertia: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    ell = trimesh.util.concatenate(
        [
            trimesh.creation.box(bounds=[[0, 0, 0], [0.4, 0.1, 0.1]]),
            trimesh.creation.box(bounds=[[0, 0.1, 0], [0.1, 0.4, 0.1]]),
        ]
    )
    ell.export(tmp_path / "ell.obj")
    open_box = trimesh.creation.box(extents=[0.2, 0.2, 0.2])
    open_box.update_faces(np.arange(12) > 1)
    open_box.export(tmp_path / "open.obj")  # of another body, which MuJoCo could not fill exactly
    body = world(
        '<body name="b"><freejoint/><geom type="mesh" mesh="ell" density="1200"/></body>'
        '<body name="o" pos="3 0 0"><freejoint/><geom type="mesh" mesh="open" density="300"/></body>'
    )
    meshes = f'<mesh name="ell" file="ell.obj"{inertia}/><mesh name="open" file="open.obj"/>'
    model = body.replace("<mujoco>", f"<mujoco><asset>{meshes}</asset>")
    mass = load(tmp_path, model, more='payload.body = "b"').payload.inertia().mass
    if inertia:
        assert mass == pytest.approx(8.4, rel=1e-6)
        assert caplog.text == ""
    else:
        assert mass > 9.6
        assert "by a rule that is exact for convex ones only" in caplog.text
        assert "there would be 0.007 m³" in caplog.text


@pytest.mark.parametrize(("inertia", "makes"), [("legacy", "0.02726"), ("convex", "0.036")])
def test_meshes_that_mujoco_cannot_fill_exactly_are_remarked(
    inertia: str, makes: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Two boxes that touch, of which one has an edge in a face of the other's."""
    upper = trimesh.creation.box(bounds=[[-0.4, 0.0, -0.05], [0.4, 0.2, 0.05]])
    lower = trimesh.creation.box(bounds=[[0.2, -0.4, -0.05], [0.4, 0.0, 0.05]])
    trimesh.util.concatenate([upper, lower]).export(tmp_path / "ell.stl")
    body = world('<body name="b"><freejoint/><geom type="mesh" mesh="ell" density="400"/></body>')
    mesh = f'<asset><mesh name="ell" file="ell.stl" inertia="{inertia}"/></asset>'
    mass = load(tmp_path, body.replace("<mujoco>", f"<mujoco>{mesh}")).payload.inertia().mass
    assert mass == pytest.approx(400.0 * float(makes), rel=1e-3)
    assert f"which makes {makes} m³; up to their surfaces there would be 0.024 m³" in caplog.text


@pytest.mark.parametrize(
    ("at", "inertia", "message"),
    [
        ("100 0 0", 0.1, "the centre of mass is 99.8 m outside"),
        ("0 0 0", 1e5, "of a box .* but its shapes are 0.4 m"),
        ("0 0 0", 1e-6, "of a box 0.001 m long, but its shapes are 0.4 m"),
    ],
)
def test_mass_properties_in_other_units_than_shapes_are_refused(
    at: str, inertia: float, message: str, tmp_path: Path
) -> None:
    text = (
        f'<robot name="crate"><link name="crate"><inertial><origin xyz="{at}"/><mass value="6"/><inertia '
        f'ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial><collision><geometry>'
        f'<box size="0.4 0.3 0.2"/></geometry></collision></link></robot>'
    )
    with pytest.raises(ScenarioError, match=message):
        load(tmp_path, text, "crate.urdf")


@pytest.mark.parametrize("size", [0.0004, 300.0])
def test_other_units_are_refused(size: float, tmp_path: Path) -> None:
    model = world(f'<body name="b"><geom type="box" size="{size} {size / 2} {size / 4}" mass="4"/></body>')
    with pytest.raises(
        ScenarioError, match=r"the body is .* m long, expected at (least|most) .*: lengths in models are"
    ):
        load(tmp_path, model)


@pytest.mark.parametrize(
    ("shape", "compiler", "words"),
    [
        ('density="250"', "", ""),
        ('mass="6"', "", ""),
        ("", "", "24 kg of 24 kg are of shapes of 1000 kg/m³, with which MuJoCo fills them if a file gives neither"),
        ('mass="6"', '<compiler boundmass="7"/>', "boundmass, boundinertia, balanceinertia or settotalmass of its"),
        ('mass="6"', '<compiler settotalmass="9"/>', "balanceinertia or settotalmass of its compiler change"),
        ('mass="6"', '<compiler boundmass="5" balanceinertia="true"/>', ""),
    ],
)
def test_mass_that_a_file_does_not_say_is_remarked(
    shape: str, compiler: str, words: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    body = f'<body name="b"><freejoint/><geom type="box" size="0.2 0.15 0.1" {shape}/></body>'
    load(tmp_path, world(body).replace("<mujoco>", f"<mujoco>{compiler}"))
    assert words in caplog.text
    assert bool(words) == bool(caplog.text)


@pytest.mark.parametrize(
    ("file", "advice"),
    [
        ("part.dae", "MuJoCo reads meshes in binary .stl, and .obj: convert them"),
        ("ascii.stl", "MuJoCo reads meshes in binary .stl, and .obj: convert them"),
        ("package://robots/part.stl", "packages of ROS are not known here: give the path relative to this file"),
        ("file:///part.stl", "give the path of the mesh without file://"),
        ("$(find robots)/part.stl", "run xacro first"),
    ],
)
def test_meshes_that_mujoco_does_not_read_are_named(file: str, advice: str, tmp_path: Path) -> None:
    (tmp_path / "part.dae").write_text("<COLLADA/>")
    (tmp_path / "ascii.stl").write_text(trimesh.exchange.stl.export_stl_ascii(trimesh.creation.box()))
    shape = f'<collision><geometry><mesh filename="{file}"/></geometry></collision>'
    with pytest.raises(ScenarioError, match=f"; {advice}$"):
        load(tmp_path, f'<robot name="r"><link name="l">{shape}</link></robot>', "part.urdf")


@pytest.mark.parametrize(
    ("model", "advice"),
    [
        ("<mujoco><worldbody>", "is it whole[?] Expected MJCF or URDF, as XML in UTF-8"),
        ("", "is it whole[?] Expected MJCF or URDF, as XML in UTF-8"),
        (world('<body><freejoint/><geom size="0.1" mass="0"/></body>'), "give its shapes a density or a mass, .*"),
        (world('<body><include file="gone.xml"/></body>'), "expected it there: paths are relative to this file, .*"),
        ('<sdf version="1.7"/>', "expected MJCF, <mujoco>, or URDF, <robot>: convert other formats"),
        (
            f'<mujoco><compiler inertiafromgeom="false"/>{world(f"<body><freejoint/>{PLATE}</body>")[8:]}',
            ".* inertiafromgeom = false only the latter counts",
        ),
        (
            world('<body><inertial pos="0 0 0" mass="6" diaginertia="0.1 0.2 0.6"/></body>'),
            "no body has such moments of inertia: .* 'balanceinertia' would make others of them",
        ),
    ],
)
def test_models_that_mujoco_does_not_read_come_with_advice(model: str, advice: str, tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=f"MuJoCo cannot use it: .*; {advice}$"):
        load(tmp_path, model)


def test_expressions_in_a_urdf_are_named(tmp_path: Path) -> None:
    text = '<robot name="r"><link name="l"><inertial><mass value="${m}"/></inertial></link></robot>'
    with pytest.raises(ScenarioError, match="expected numbers: if there are expressions, run xacro first"):
        load(tmp_path, text, "part.urdf")


def test_macros_in_a_urdf_are_not_ignored(tmp_path: Path) -> None:
    text = f'<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">{LINK}</robot>'
    assert load(tmp_path, text, "part.urdf").payload.inertia().mass == pytest.approx(6.0)
    macro = '<xacro:mass_of_box mass="6"/>'
    commented = text.replace("<collision>", f"<!-- was\n{macro} --><collision>")
    assert load(tmp_path, commented, "part.urdf").payload.inertia().mass == pytest.approx(6.0)
    text = text.replace("<collision>", f"{macro}<collision>")
    with pytest.raises(ScenarioError, match="elements of xacro, which MuJoCo would ignore: run xacro first"):
        load(tmp_path, text, "part.urdf")

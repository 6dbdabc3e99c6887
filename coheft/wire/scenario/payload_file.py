"""Payloads from users' files: reads a body of a model, or a mesh, when a scenario is loaded.

What comes after, on whatever host, knows mass properties, grasps and some triangles to draw, and opens no file.
Libraries for files are imported only if a scenario names one, and never by an agent.
"""

import re
from pathlib import Path

import msgspec

from coheft.errors import refuse_scenario
from coheft.wire.scenario.payload import MassProperties, Payload
from coheft.wire.scenario.payload_body import HeldBody
from coheft.wire.scenario.payload_extent import Extent, grasp_complaints
from coheft.wire.scenario.payload_mesh import filled, read_triangles
from coheft.wire.scenario.payload_model import read_model
from coheft.wire.scenario.payload_surface import to_text
from coheft.wire.scenario.rules import check
from coheft.wire.scenario.schema import Scenario

_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
_MESHES = "MuJoCo reads meshes in binary .stl, and .obj: convert them"
_XML = "is it whole? Expected MJCF or URDF, as XML in UTF-8"
_ADVICE = {
    "stl_decoder": _MESHES,
    "no decoder found for mesh": _MESHES,
    "decoder": "expected MJCF, .xml, or URDF, .urdf, in lower case: run xacro first, and convert other formats",
    "Unrecognized XML model type": "expected MJCF, <mujoco>, or URDF, <robot>: convert other formats",
    "bad format in attribute": "expected numbers: if there are expressions, run xacro first",
    "$(": "run xacro first",
    "file:/": "give the path of the mesh without file://",
    "package:/": "packages of ROS are not known here: give the path relative to this file",
    "Error opening file": "expected it there: paths are relative to this file, and to 'meshdir' of its compiler",
    "mjMINVAL": "give its shapes a density or a mass, or the body an <inertial>, in kg and metres; with "
    "inertiafromgeom = false only the latter counts",
    "A + B >= C": "no body has such moments of inertia: are they those at its centre of mass, each at its place? "
    "'balanceinertia' would make others of them",
    "ParseXML": _XML,
    "XML parse error": _XML,
    "codec can't decode": _XML,
}
"""What to do about MuJoCo's errors, by a part of their texts; the first that fits counts."""


def read_files(scenario: Scenario, origin: str, folder: Path) -> Scenario:
    """Return the scenario with mass properties and grasps in place of the files and sites that it names.

    It is as written, see ``checks.choice_complaints``; other arguments, and errors, as for ``file.scenario_of``.
    """
    payload, robots = scenario.payload, scenario.robots
    if payload.mjcf is not None:
        place = f"{origin}: key 'payload.mjcf'"
        path = _existing(folder, payload.mjcf, place)
        if b"<xacro:" in _COMMENT.sub(b"", path.read_bytes()):
            refuse_scenario(place, f"{path} has elements of xacro, which MuJoCo would ignore: run xacro first")
        try:
            model = read_model(path)
        except ValueError as error:
            reason = " ".join(str(error).split())
            advice = next((f"; {words}" for sign, words in _ADVICE.items() if sign in reason), "")
            refuse_scenario(place, f"{path}: MuJoCo cannot use it: {reason}{advice}")
        body = HeldBody.find(model, payload.body, f"{origin}: key 'payload.body'")
        whole = body.inertia(place)
        properties = MassProperties.of(whole)
        extent, surface = body.extent(properties), body.surface()
        advice = "lengths in models are in metres"
        complaint = extent.file_complaint("the body", advice, advice) or extent.properties_complaint(properties)
        if complaint:
            refuse_scenario(place, complaint)
        body.remark_doubts(place, whole)
        if robots.sites:
            grasps = body.grasps(robots.sites, extent, f"{origin}: key 'robots.sites'")
            robots = msgspec.structs.replace(robots, sites=(), grasps=grasps)
    elif payload.mesh is not None:
        place = f"{origin}: key 'payload.mesh'"
        path = _existing(folder, payload.mesh, place)
        try:
            triangles = read_triangles(path) * payload.scale
        except ValueError as error:
            refuse_scenario(place, f"{path}: {' '.join(str(error).split())}")
        extent = Extent.around(triangles.reshape(-1, 3))
        if_long = "if it is drawn in millimetres, set 'payload.scale' = 0.001"
        if_short = f"set 'payload.scale' to the length of its unit in metres, now {payload.scale:g}"
        if complaint := extent.file_complaint("the mesh", if_long, if_short):
            refuse_scenario(place, complaint)
        properties, surface = MassProperties.of(filled(triangles, payload.mass, payload.density, place)), triangles
    else:
        return scenario
    check(scenario, origin, lambda written: grasp_complaints(written, extent))
    held = Payload(properties=properties, load_slots=payload.load_slots, surface=to_text(surface))
    return msgspec.structs.replace(scenario, payload=held, robots=robots)


def _existing(folder: Path, name: str, place: str) -> Path:
    """Return the path of a file, which has to be readable."""
    path = folder / name
    try:
        path.open("rb").close()
    except OSError as error:
        refuse_scenario(place, f"{path} cannot be read: {error.strerror}; paths are relative to the scenario's file")
    except ValueError as error:
        refuse_scenario(place, f"{name!r}: no file can have this name: {error}")
    return path

"""MuJoCo models of payloads, from users' files.

A model is compiled for its mass properties and shapes alone: what it looks like, and how it is driven and measured, do
not matter, so pictures may be missing. What MuJoCo warns of is written to the log.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from math import isnan, nan
from pathlib import Path
from typing import TYPE_CHECKING

from coheft.wire.process.log import LOG

if TYPE_CHECKING:
    import mujoco


DEFAULT_DENSITY = 1000.0
"""Density with which MuJoCo fills shapes [kg/m³]."""


@dataclass(frozen=True)
class PayloadModel:
    """A compiled model, with parts of its file that MuJoCo does not keep.

    Attributes:
        compiled: The model; its bodies have unique names.
        floating: Bodies that have a free joint.
        weighing: Shapes from which MuJoCo computes mass properties.
    """

    compiled: mujoco.MjModel
    floating: tuple[int, ...]
    weighing: tuple[int, ...]
    spec: mujoco.MjSpec

    def variant(
        self, held: Sequence[int], change: Callable[[mujoco.MjSpec, list[mujoco.MjsBody]], None]
    ) -> mujoco.MjModel | None:
        """Return the model after a change to some bodies of its file; None if MuJoCo cannot compile it.

        Args:
            held: Numbers of these bodies. All others get made-up mass properties, so that they never matter.
            change: Changes the file, of which it gets these bodies.
        """
        with warnings.catch_warnings(action="ignore"), _without_log_file():
            changed = self.spec.copy()
            bodies = dict(enumerate(list(changed.bodies)[1:], start=1))
            for number in bodies.keys() - set(held):
                _make_up_inertia(bodies[number])
            change(changed, [bodies[number] for number in held])
            try:
                return changed.compile()
            except ValueError:
                return None


def read_model(path: Path) -> PayloadModel:
    """Read the model of an MJCF or URDF file.

    A body without a name is called ``body N``, counted from 1 in the order of the file (``body N_`` if another body is
    called so). Bodies that are fixed to others stay bodies of their own, so a free joint below a link that is fixed to
    the world, as URDF files have it, is taken off: MuJoCo allows it only where such links are made parts of the world.

    Raises:
        ValueError: MuJoCo cannot use it.
    """
    import mujoco

    with _warnings_to_log(path):
        spec = mujoco.MjSpec.from_file(str(path))
        _leave_out_unused(spec)
        bodies = list(spec.bodies)[1:]
        floating = [number for number, body in enumerate(bodies, start=1) if _take_off_free_joint(spec, body)]
        spec.compiler.fusestatic = spec.compiler.discardvisual = False  # bodies keep their names, and all shapes
        taken = {body.name for body in bodies}
        for number, body in enumerate(bodies, start=1):
            numbered = (f"body {number}" + "_" * more for more in count())
            body.name = body.name or next(name for name in numbered if name not in taken)
        compiled = spec.compile()
    lowest, highest = spec.compiler.inertiagrouprange
    shapes = [geom for body in bodies if _weighs_by_shapes(spec, body) for geom in body.geoms]
    weighing = tuple(
        geom.id
        for geom in shapes
        if lowest <= geom.group <= highest and geom.mass != 0.0 and (geom.mass > 0.0 or geom.density > 0.0)
    )
    return PayloadModel(compiled, tuple(floating), weighing, spec)


def _weighs_by_shapes(spec: mujoco.MjSpec, body: mujoco.MjsBody) -> bool:
    import mujoco

    always = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    return bool(always or not body.explicitinertial)


def _leave_out_unused(spec: mujoco.MjSpec) -> None:
    """Take off what has no mass, but needs files that may be missing, or free joints that may be taken off.

    These are skins, keyframes, actuators and sensors, and tuples, which may list them. Every texture gets one colour
    and, as only a sky needs none, a name, so that no image is read.
    """
    import mujoco

    for element in (*spec.skins, *spec.keys, *spec.tuples, *spec.actuators, *spec.sensors):
        spec.delete(element)
    for number, texture in enumerate(spec.textures):
        texture.name = texture.name or f"texture {number}"
        texture.file, texture.cubefiles = "", [""] * 6
        texture.type, texture.builtin = mujoco.mjtTexture.mjTEXTURE_2D, mujoco.mjtBuiltin.mjBUILTIN_FLAT
        texture.width = texture.height = 1


def _take_off_free_joint(spec: mujoco.MjSpec, body: mujoco.MjsBody) -> bool:
    """Whether a body floats. It keeps its frame, whatever ``align`` says; and if links between it and the world have no
    joints, its own joint is removed.
    """
    import mujoco

    free = [joint for joint in body.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
    for joint in free:  # not the frame of its principal axes, in which no grasp is written
        joint.align = mujoco.mjtAlignFree.mjALIGNFREE_FALSE
    above = body.parent
    while above != spec.worldbody and not above.joints:
        above = above.parent
    if above == spec.worldbody and body.parent != spec.worldbody:
        for joint in free:
            spec.delete(joint)
    return bool(free)


def _make_up_inertia(body: mujoco.MjsBody) -> None:
    body.explicitinertial, body.mass = True, 1.0
    body.inertia, body.fullinertia = [1.0] * 3, [nan] * 6


def leave_out_looks(_: mujoco.MjSpec, held: list[mujoco.MjsBody]) -> None:
    """Make visual shapes, which collide with nothing, massless, except in moving bodies that have no others."""
    for body in held:
        looks = [geom for geom in body.geoms if not (geom.contype or geom.conaffinity)]
        if len(looks) < len(body.geoms) or not body.joints:
            for geom in looks:
                geom.mass = 0.0


def leave_out_defaults(spec: mujoco.MjSpec, held: list[mujoco.MjsBody]) -> None:
    """Make shapes massless that have neither a mass nor a density of their own: MuJoCo takes ``DEFAULT_DENSITY``."""
    for body in held:
        if _weighs_by_shapes(spec, body):
            for geom in body.geoms:
                if isnan(geom.mass) and geom.density == DEFAULT_DENSITY:
                    geom.mass = 0.0


def keep_what_is_written(spec: mujoco.MjSpec, _: list[mujoco.MjsBody]) -> None:
    """Let the compiler change no masses and no moments of inertia."""
    compiler = spec.compiler
    compiler.boundmass, compiler.boundinertia, compiler.balanceinertia = 0.0, 0.0, False
    compiler.settotalmass = -1.0


@contextmanager
def _warnings_to_log(path: Path) -> Iterator[None]:
    with warnings.catch_warnings(record=True) as caught, _without_log_file():
        warnings.simplefilter("always")
        yield
    for text in dict.fromkeys(" ".join(str(warning.message).split()) for warning in caught):
        LOG.warning("coheft: %s: MuJoCo warns: %s", path, text)


@contextmanager
def _without_log_file() -> Iterator[None]:
    """Keep MuJoCo from writing ``MUJOCO_LOG.TXT`` into the folder where the user happens to be: Python warns, too."""
    import mujoco

    former = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(former)

"""Loads in the formats of models and arm controllers, with their own frames and units, and compared with limits."""

import warnings
from collections.abc import Callable, Iterable
from typing import Literal
from xml.sax.saxutils import quoteattr

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from coheft.app.export.found_load import FoundLoad
from coheft.errors import CoheftError, UsageError
from coheft.estimation.linear_algebra import principal_axes
from coheft.estimation.rigid_body.mass_properties import pack_symmetric
from coheft.wire.scenario.section import pose_of

DEVIATIONS = 3.0
"""Standard deviations by which a number may be wrong."""
Answer = Literal["within", "unclear", "exceeds"]
Format = Literal["urdf", "mjcf", "franka", "ur", "kuka"]
Target = Format | Literal["verdict"]
Placement = tuple[float, float, float, float, float, float]
"""Pose of the grasp frame in the frame of the flange: position [m], rotation vector [degrees]."""
_LARGEST_OF_UR = 133.0
"""Largest component that ``set_target_payload`` accepts [kg·m²]."""


class Limits(msgspec.Struct, frozen=True):
    """Limits of a load's mass [kg], offset [m] and inertia [kg·m²]; None if there is none.

    The offset is the distance of its centre of mass from the frame's origin, the inertia the largest principal moment
    about its centre of mass.
    """

    mass: float | None = None
    offset: float | None = None
    inertia: float | None = None


class Part(msgspec.Struct, frozen=True):
    """A number with its uncertainty and its limit.

    Attributes:
        low: Lower bound with the uncertainty.
        high: Upper bound with the uncertainty.
        answer: ``within``: also ``high`` is; ``exceeds``: not even ``low`` is within; ``unclear``: in between.
    """

    value: float
    low: float
    high: float
    limit: float | None
    answer: Answer


class LoadVerdict(msgspec.Struct, frozen=True):
    """A load compared with limits.

    Attributes:
        answer: The worst of all parts.
        mass: [kg].
        offset: Distance of the centre of mass from the frame's origin [m].
        inertia: Largest principal moment about the centre of mass [kg·m²].
        com: Centre of mass [m].
        tensor: Inertia about the centre of mass [kg·m²].
        frame: Description of the frame of these.
    """

    answer: Answer
    mass: Part
    offset: Part
    inertia: Part
    com: list[float]
    tensor: list[list[float]]
    frame: str
    robot: str
    source: str
    remarks: list[str]


def judge_load(load: FoundLoad, limits: Limits, frame: str) -> LoadVerdict:
    """Compare a load with limits; of offset and inertia standard deviations are bounds, so in doubt it is unclear."""
    com = load.inertia.com
    offset = float(np.linalg.norm(com))
    offset_std = float(np.abs(com) @ load.com_std / offset) if offset > 0.0 else float(np.linalg.norm(load.com_std))
    largest = float(np.linalg.eigvalsh(load.inertia.tensor)[-1])
    largest_std = float(np.linalg.norm(load.tensor_std))  # bounds the change of every eigenvalue
    parts = (
        _part(load.inertia.mass, load.mass_std, limits.mass),
        _part(offset, offset_std, limits.offset),
        _part(largest, largest_std, limits.inertia),
    )
    order: tuple[Answer, ...] = ("within", "unclear", "exceeds")
    return LoadVerdict(
        max((part.answer for part in parts), key=order.index),
        *parts,
        com=com.tolist(),
        tensor=load.inertia.tensor.tolist(),
        frame=frame,
        robot=load.robot,
        source=load.source,
        remarks=list(load.remarks),
    )


def _part(value: float, std: float, limit: float | None) -> Part:
    low, high = max(0.0, value - DEVIATIONS * std), value + DEVIATIONS * std
    answer: Answer = "within"
    if limit is not None and high > limit:
        answer = "exceeds" if low > limit else "unclear"
    return Part(value, low, high, limit, answer)


def hand_over(load: FoundLoad, target: Target, flange: Placement | None, limits: Limits) -> tuple[str, Answer]:
    """Return the text for the target, and whether the load, given in the robot's grasp frame, is within the limits.

    ``flange`` is the pose of that frame in the frame of the flange; None if they coincide.

    Raises:
        UsageError: There are limits, but the target is not a verdict.
        CoheftError: The target does not accept such a load.
    """
    if target != "verdict" and limits != Limits():
        raise UsageError("limits of mass, offset and inertia are for a verdict: add --as verdict, or leave them out")
    frame = f"grasp frame of {load.robot}, taken as the flange frame"
    if flange is not None:
        load = load.seen_from(pose_of(flange[:3], flange[3:]))
        frame = f"flange, with the grasp frame of {load.robot} at {' '.join(f'{x:g}' for x in flange)} (m, degrees)"
    if target == "verdict":
        verdict = judge_load(load, limits, frame)
        return msgspec.json.format(msgspec.json.encode(verdict)).decode() + "\n", verdict.answer
    return export_load(load, target, frame), "within"


def export_load(load: FoundLoad, format: Format, frame: str) -> str:
    """Return the text for a model or a controller, or raise a ``CoheftError`` if that does not accept such a load.

    ``frame`` describes the load's frame, which is the one used there.
    """
    begin, end, write = _FORMATS[format]
    mass, std = load.inertia.mass, load.mass_std
    lines = [
        f"From {load.source}, found by {load.robot}. Frame: {frame}.",
        f"The whole load, for an arm that holds it alone: {mass:.6g} kg, standard deviation {std:.2g} kg.",
        *load.remarks,
    ]
    comments = "".join(f"{begin}{line.replace('--', '- -') if end else line}{end}\n" for line in lines)
    return comments + write(load)


def _urdf(load: FoundLoad) -> str:
    """Inertia about the centre of mass in the axes of the link; metres, kilograms."""
    xx, yy, zz, xy, xz, yz = pack_symmetric(load.inertia.tensor)
    entries = {"ixx": xx, "ixy": xy, "ixz": xz, "iyy": yy, "iyz": yz, "izz": zz}
    return (
        "<inertial>\n"
        f'  <origin xyz="{_numbers(load.inertia.com, " ")}" rpy="0 0 0"/>\n'
        f'  <mass value="{load.inertia.mass:.9g}"/>\n'
        f"  <inertia {' '.join(f'{name}={quoteattr(_number(value))}' for name, value in entries.items())}/>\n"
        "</inertial>\n"
    )


def _mjcf(load: FoundLoad) -> str:
    """Inertia about the centre of mass in the axes of the body."""
    inertia = load.inertia
    return (
        f'<inertial pos="{_numbers(inertia.com, " ")}" mass="{_number(inertia.mass)}" '
        f'fullinertia="{_numbers(pack_symmetric(inertia.tensor), " ")}"/>\n'
    )


def _franka(load: FoundLoad) -> str:
    """libfranka: mass [kg], centre of mass in the flange's frame [m], inertia about it, column by column [kg·m²]."""
    inertia = load.inertia
    columns = _numbers(inertia.tensor.T.ravel(), ", ")
    return f"robot.setLoad({_number(inertia.mass)}, {{{{{_numbers(inertia.com, ', ')}}}}}, {{{{{columns}}}}});\n"


def _ur(load: FoundLoad) -> str:
    """URScript: mass [kg], centre of mass from the tool flange [m], inertia about it in the flange's axes [kg·m²]."""
    inertia = load.inertia
    packed = pack_symmetric(inertia.tensor)
    if np.abs(packed).max() > _LARGEST_OF_UR:
        raise CoheftError(
            f"set_target_payload takes moments of inertia up to {_LARGEST_OF_UR:g} kg·m²; found "
            f"{np.abs(packed).max():.4g} kg·m²"
        )
    return f"set_target_payload({_number(inertia.mass)}, [{_numbers(inertia.com, ', ')}], [{_numbers(packed, ', ')}])\n"


def _kuka(load: FoundLoad) -> str:
    """KRL: mass [kg], centre of mass in the flange's frame [mm], principal axes as angles [°], moments [kg·m²]."""
    inertia = load.inertia
    moments, axes = principal_axes(inertia.tensor)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # if B is ±90°, one of the other two can be chosen
        angles = Rotation.from_matrix(axes).as_euler("ZYX", degrees=True)  # axes = Rz(A) Ry(B) Rx(C)
    centre = _named("XYZ", 1e3 * inertia.com) + "," + _named("ABC", angles)
    return f"LOAD_DATA[1]={{M {_decimal(inertia.mass)},CM {{{centre}}},J {{{_named('XYZ', moments)}}}}}\n"


def _number(value: float) -> str:
    return f"{value + 0.0:.9g}"


def _decimal(value: float) -> str:
    """Format a real number for KRL: with a point, without an exponent."""
    return f"{value + 0.0:.6f}"


def _numbers(values: Iterable[float], between: str) -> str:
    return between.join(map(_number, values))


def _named(names: str, values: Iterable[float]) -> str:
    return ",".join(f"{name} {_decimal(value)}" for name, value in zip(names, values, strict=True))


_FORMATS: dict[Format, tuple[str, str, Callable[[FoundLoad], str]]] = {
    "urdf": ("<!-- ", " -->", _urdf),
    "mjcf": ("<!-- ", " -->", _mjcf),
    "franka": ("// ", "", _franka),
    "ur": ("# ", "", _ur),
    "kuka": ("; ", "", _kuka),
}
"""Begin and end of a comment, and the function that writes the load."""

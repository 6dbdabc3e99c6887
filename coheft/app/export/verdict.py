"""Comparison of a load with limits, with its uncertainty taken into account."""

from typing import Literal

import msgspec
import numpy as np

from coheft.app.export.found_load import FoundLoad

DEVIATIONS = 3.0
"""Standard deviations by which a number may be wrong."""

Answer = Literal["within", "unclear", "exceeds"]


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

"""Size of a payload, and the rules that grasps and loads are at plausible places.

Lengths in millimetres instead of metres are a common mistake in files, and a run with such lengths may fail late and in
other ways.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Self

import numpy as np

from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.mass_properties import edges_of_box
from coheft.wire.scenario.payload import MassProperties, Payload
from coheft.wire.scenario.rules import Complaint
from coheft.wire.scenario.schema import Scenario
from coheft.wire.scenario.section import pose_of

LARGEST = 20.0
"""Largest length of a payload [m]."""
_SMALLEST = 0.005
"""Smallest length of a payload from a file [m]."""
ARM_ROOM = 0.3
"""Distance from any payload at which grasps and loads are allowed [m]: wrist frames are behind the hand."""
_UNKNOWN_SHAPE = 10.0
"""Factor for the extent of a payload that is given by mass properties only: light parts may extend further."""


@dataclass(frozen=True)
class Extent:
    """A box around a payload, edges along the axes of the payload's frame.

    Attributes:
        lower: Its smallest coordinates, shape (3,) [m].
        upper: Its largest coordinates, shape (3,) [m].
        margin: Distance outside of it at which a grasp or a load is allowed [m].
    """

    lower: Array
    upper: Array
    margin: float

    @classmethod
    def around(cls, points: Array) -> Self:
        """Return the smallest box around points, shape (n, 3), in the payload's frame [m]."""
        lower, upper = points.min(axis=0), points.max(axis=0)
        return cls(lower, upper, max(ARM_ROOM, float(np.max(upper - lower))))

    @classmethod
    def like(cls, properties: MassProperties) -> Self:
        """Return the box around the homogeneous box with given mass properties."""
        edges = edges_of_box(properties.mass, np.array(properties.principal, dtype=np.float64))
        box = cls.around(corners(pose_of(properties.com, properties.axes_deg), edges))
        return cls(box.lower, box.upper, _UNKNOWN_SHAPE * box.margin)

    @property
    def length(self) -> float:
        """Its longest edge [m]."""
        return float(np.max(self.upper - self.lower))

    def length_complaint(self, what: str, if_long: str) -> str:
        """Describe a payload that is too long to be carried, and the possible cause; empty if it is not."""
        if self.length <= LARGEST:
            return ""
        return f"{what} is {self.length:g} m long, expected at most {LARGEST:g} m: {if_long}"

    def file_complaint(self, what: str, if_long: str, if_short: str) -> str:
        """Describe a payload from a file that probably has another unit; empty if its length is plausible."""
        if self.length < _SMALLEST:
            return f"{what} is {self.length:g} m long, expected at least {_SMALLEST:g} m: {if_short}"
        return self.length_complaint(what, if_long)

    def properties_complaint(self, properties: MassProperties) -> str:
        """Describe mass properties from a file that cannot be those of something with the shapes in it; or empty."""
        if complaint := self.complaint(properties.com):
            return f"the centre of mass {complaint}"
        length = Extent.like(properties).length
        if self.length / _UNKNOWN_SHAPE**2 < length <= _UNKNOWN_SHAPE * self.length:
            return ""
        return (
            f"its moments of inertia are those of a box {length:.3g} m long, but its shapes are {self.length:.3g} m "
            f"long: moments of inertia are in kg·m²"
        )

    def complaint(self, position: Iterable[float]) -> str:
        """Describe what is wrong with the position of a grasp or a load [m], as the end of a sentence; or empty."""
        point = np.array(tuple(position), dtype=np.float64)
        with np.errstate(over="ignore"):
            distance = float(np.linalg.norm(np.maximum(0.0, np.maximum(self.lower - point, point - self.upper))))
        if distance <= self.margin:
            return ""
        return (
            f"is {distance:.3g} m outside the payload, which is {self.length:.2g} m long; expected at most "
            f"{self.margin:.2g} m: positions are in metres, in the payload's frame"
        )

    def size_complaint(self, size: Iterable[float]) -> str:
        """Describe what is wrong with the edge lengths of a load [m], as the end of a sentence; or empty."""
        longest, limit = max(size), self.length + 2.0 * self.margin
        if longest <= limit:
            return ""
        return (
            f"is {longest:.3g} m long; expected at most {limit:.2g} m on a payload that is {self.length:.2g} m long: "
            f"sizes are in metres"
        )


def corners(pose: Pose, edges: Iterable[float]) -> Array:
    """Return the corners of a box, shape (8, 3), from the pose of its centre and its edge lengths [m]."""
    halves = np.array(list(product((-0.5, 0.5), repeat=3))) * np.array(tuple(edges), dtype=np.float64)
    return halves @ pose.rotation.T + pose.translation


@np.errstate(all="ignore")
def place_complaints(scenario: Scenario) -> list[Complaint]:
    """Complain about the size and the grasps of a payload that is given by boxes or mass properties."""
    payload = scenario.payload
    if not payload.boxes and payload.properties is None:  # ``payload_file`` reads it, and checks it then
        return []
    extent = extent_of(payload)
    key, what, advice = "payload.boxes", "the payload", "sizes and positions are in metres"
    if payload.properties is not None:
        key, what = "payload.properties", "a box with such mass properties"
        advice = "masses are in kg, moments of inertia in kg·m²"
    complaint = extent.length_complaint(what, advice)
    return [(key, complaint)] if complaint else list(grasp_complaints(scenario, extent))


def grasp_complaints(scenario: Scenario, extent: Extent) -> Iterator[Complaint]:
    """Complain about grasps far outside of the payload; those at sites of a model are not checked."""
    for number, grasp in enumerate(scenario.robots.grasps):
        if complaint := extent.complaint(grasp.position):
            yield f"robots.grasps[{number}].position", f"found {list(grasp.position)}, which {complaint}"
    if (perimeter := scenario.robots.perimeter) is not None:
        width, depth = perimeter.extent
        for side in ((width / 2.0, 0.0, 0.0), (0.0, depth / 2.0, 0.0)):
            if complaint := extent.complaint(side):
                yield "robots.perimeter.extent", f"found {list(perimeter.extent)}, of which a side {complaint}"


def load_place_complaints(scenario: Scenario) -> Iterator[Complaint]:
    """Complain about loads far outside of the payload, or too large for it."""
    extent = extent_of(scenario.payload)
    for number, change in enumerate(scenario.load_changes):
        if change.mass is not None:
            if complaint := extent.complaint(change.position):
                yield f"load_changes[{number}].position", f"found {list(change.position)}, which {complaint}"
            if complaint := extent.size_complaint(change.size):
                yield f"load_changes[{number}].size", f"found {list(change.size)}, which {complaint}"


def extent_of(payload: Payload) -> Extent:
    """Return the extent of boxes, or else of mass properties; a payload from a file has been read."""
    if payload.properties is not None:
        return Extent.like(payload.properties)
    return Extent.around(np.concatenate([corners(box.pose(), box.size) for box in payload.boxes]))

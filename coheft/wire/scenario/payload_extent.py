"""Size of a payload, and checks that grasps and loads are at plausible places.

Lengths in millimetres instead of metres are a common mistake in files, and a run with such lengths may fail late and in
other ways.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Self

import numpy as np

from coheft.errors import ScenarioError
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.wire.scenario.payload import MassProperties, Payload
from coheft.wire.scenario.schema import Scenario
from coheft.wire.scenario.section import pose_of

LARGEST = 20.0
"""Largest length of a payload [m]."""
_SMALLEST = 0.005
"""Smallest length of a payload from a file [m]."""
ARM_ROOM = 0.3
"""Distance from any payload at which grasps and loads are allowed [m]: wrist frames are behind the hand."""
_UNSEEN = 10.0
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
        moments = np.array(properties.principal, dtype=np.float64)
        # For a box, J_x = m (y² + z²) / 12, and so on.
        edges = np.sqrt(np.maximum(6.0 / properties.mass * (moments.sum() - 2.0 * moments), 0.0))
        box = cls.around(corners(pose_of(properties.com, properties.axes_deg), edges))
        return cls(box.lower, box.upper, _UNSEEN * box.margin)

    @property
    def length(self) -> float:
        """Its longest edge [m]."""
        return float(np.max(self.upper - self.lower))

    def distance(self, point: Iterable[float]) -> float:
        """Return the distance of a point from the box [m]; 0 inside."""
        position = np.array(tuple(point), dtype=np.float64)
        return float(np.linalg.norm(np.maximum(0.0, np.maximum(self.lower - position, position - self.upper))))

    def check_size(self, place: str, what: str, advice: str) -> None:
        """Check that the payload is small enough to be carried.

        Args:
            place: Key of the scenario.
            what: Name in errors.
            advice: Possible cause.

        Raises:
            ScenarioError: It is too large.
        """
        if not self.length <= LARGEST:
            raise ScenarioError(f"{place}: {what} is {self.length:g} m long, expected at most {LARGEST:g} m: {advice}")

    def check_file_size(self, place: str, what: str, advice_if_large: str, advice_if_small: str) -> None:
        """Check that a payload from a file has a plausible size.

        Raises:
            ScenarioError: It is too large or too small, so the file probably has another unit.
        """
        self.check_size(place, what, advice_if_large)
        if self.length < _SMALLEST:
            raise ScenarioError(
                f"{place}: {what} is {self.length:g} m long, expected at least {_SMALLEST:g} m: {advice_if_small}"
            )

    def check_properties(self, place: str, properties: MassProperties) -> None:
        """Check that mass properties from a file can be those of something with the shapes in it.

        Raises:
            ScenarioError: The centre of mass is too far outside, or moments of inertia are of something far larger or
                smaller.
        """
        self.check_position(place, "the centre of mass", properties.com)
        length = Extent.like(properties).length
        if not self.length / _UNSEEN**2 < length < _UNSEEN * self.length:
            raise ScenarioError(
                f"{place}: its moments of inertia are those of a box {length:.3g} m long, but its shapes are "
                f"{self.length:.3g} m long: moments of inertia are in kg·m²"
            )

    def check_position(self, place: str, what: str, position: Iterable[float]) -> None:
        """Check that a grasp or a load is not too far outside.

        Args:
            place: Key of the scenario.
            what: Name in errors.
            position: Position in the payload's frame [m].

        Raises:
            ScenarioError: It is.
        """
        complaint = self.complaint(position)
        if complaint:
            raise ScenarioError(f"{place}: {what} {complaint}")

    def complaint(self, position: Iterable[float]) -> str:
        """Describe what is wrong with the position of a grasp or a load [m], as the end of a sentence; empty if it is
        valid.
        """
        with np.errstate(over="ignore"):
            distance = self.distance(position)
        if distance <= self.margin:
            return ""
        return (
            f"is {distance:.3g} m outside the payload, which is {self.length:.2g} m long; expected at most "
            f"{self.margin:.2g} m: positions are in metres, in the payload's frame"
        )

    def size_complaint(self, size: Iterable[float]) -> str:
        """Describe what is wrong with the edge lengths of a load [m], as the end of a sentence; empty if they are
        valid.
        """
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
    moved: Array = halves @ pose.rotation.T + pose.translation
    return moved


def check_places(scenario: Scenario, origin: str) -> None:
    """Check the size and the grasps of a payload that is given by boxes or mass properties.

    Raises:
        ScenarioError: A length or position is implausible.
    """
    payload = scenario.payload
    with np.errstate(all="ignore"):
        extent = _extent_of(payload)
        if extent is None:
            return
        if payload.properties is not None:
            what, advice = "a box with such mass properties", "masses are in kg, moments of inertia in kg·m²"
            extent.check_size(f"{origin}: key 'payload.properties'", what, advice)
        else:
            extent.check_size(f"{origin}: key 'payload.boxes'", "the payload", "sizes and positions are in metres")
        check_holds(scenario, extent, origin)


def check_load_places(scenario: Scenario, origin: str) -> None:
    """Check position and size of the loads of a scenario's load changes.

    Raises:
        ScenarioError: One is too far outside of the payload, or too large for it.
    """
    extent = _extent_of(scenario.payload)
    for number, change in enumerate(scenario.load_changes):
        if change.mass is not None and extent is not None:
            key = f"{origin}: key 'load_changes[{number}]"
            extent.check_position(f"{key}.position'", f"found {list(change.position)}, which", change.position)
            complaint = extent.size_complaint(change.size)
            if complaint:
                raise ScenarioError(f"{key}.size': found {list(change.size)}, which {complaint}")


def _extent_of(payload: Payload) -> Extent | None:
    """Return the extent of boxes or mass properties; None for a payload from a file."""
    if payload.properties is not None:
        return Extent.like(payload.properties)
    if payload.boxes:
        return Extent.around(np.concatenate([corners(box.pose(), box.size) for box in payload.boxes]))
    return None


def check_holds(scenario: Scenario, extent: Extent, origin: str) -> None:
    """Check all grasps of a scenario but those at sites of a model.

    Raises:
        ScenarioError: One is too far outside of the payload.
    """
    for key, what, position in _holds(scenario):
        extent.check_position(f"{origin}: key '{key}'", what, position)


def _holds(scenario: Scenario) -> Iterator[tuple[str, str, Iterable[float]]]:
    """Yield key, name and position of each grasp, or of the midpoints of the sides of a rim."""
    for number, grasp in enumerate(scenario.robots.grasps):
        yield f"robots.grasps[{number}].position", f"found {list(grasp.position)}, which", grasp.position
    perimeter = scenario.robots.perimeter
    if perimeter is not None:
        width, depth = perimeter.extent
        for side in ((width / 2.0, 0.0, 0.0), (0.0, depth / 2.0, 0.0)):
            yield "robots.perimeter.extent", f"found {list(perimeter.extent)}, of which a side", side

"""The payload in a scenario."""

from typing import Annotated, Self

import numpy as np
from msgspec import Meta

from coheft.estimation.geometry.spatial import Array, Pose, rotation_log
from coheft.estimation.linear_algebra import principal_axes
from coheft.estimation.measurement import Positive
from coheft.estimation.rigid_body.mass_properties import Inertia, combined
from coheft.wire.scenario.section import Lengths, Section, Vector, pose_of

_ROUNDING = 1e-9


class Box(Section, frozen=True):
    """A homogeneous box of the payload.

    Attributes:
        mass: Mass of the box [kg].
        size: Edge lengths [m].
        position: Position of its centre in the payload's frame [m].
        rotation_deg: Rotation vector of the box in the payload's frame [degrees].
    """

    mass: Positive
    size: Lengths
    position: Vector = (0.0, 0.0, 0.0)
    rotation_deg: Vector = (0.0, 0.0, 0.0)

    def pose(self) -> Pose:
        """Return the pose of the box in the payload's frame."""
        return pose_of(self.position, self.rotation_deg)

    def inertia(self) -> Inertia:
        """Return the mass properties of the box in the payload's frame."""
        return Inertia.of_box(self.mass, self.size, self.pose())


class MassProperties(Section, frozen=True):
    """A payload given by its mass properties only.

    Attributes:
        mass: Mass [kg].
        com: Centre of mass in the payload's frame [m].
        principal: Principal moments of inertia at the centre of mass [kg·m²].
        axes_deg: Rotation vector from the payload's axes to the principal ones [degrees].
    """

    mass: Positive
    com: Vector
    principal: Lengths
    axes_deg: Vector = (0.0, 0.0, 0.0)

    @classmethod
    def of(cls, inertia: Inertia) -> Self:
        """Make the properties of a body whose inertia is known in the payload's frame."""
        principal, axes = principal_axes(inertia.tensor)
        return cls(
            mass=inertia.mass,
            com=vector_of(inertia.com),
            principal=vector_of(principal),
            axes_deg=vector_of(np.degrees(rotation_log(axes))),
        )

    def can_exist(self) -> bool:
        """Return whether no moment exceeds the sum of the two others, which a plane body's largest equals."""
        *others, largest = sorted(self.principal)
        return largest <= sum(others) * (1.0 + _ROUNDING)

    def inertia(self) -> Inertia:
        """Return the inertia in the payload's frame."""
        at_com = Inertia(self.mass, np.zeros(3), np.diag(np.array(self.principal, dtype=np.float64)))
        return at_com.transported(pose_of(self.com, self.axes_deg))


class Payload(Section, frozen=True):
    """The payload: boxes fixed to each other, mass properties, or a model or mesh file.

    Paths are relative to the scenario's file. A payload that is longer than 20 m or too heavy for the arms is refused,
    since its unit is probably wrong.

    Attributes:
        boxes: Boxes that it consists of.
        properties: Instead of boxes: mass properties.
        mjcf: Instead of boxes: a MuJoCo model (MJCF or URDF), of which one body is held. The payload's frame is the
            frame of that body.
        body: Name of that body; not needed if the model has only one body, or only one with a free joint. A body
            without a name is ``body N``, counted from 1 in the order of the file.
        mesh: Instead of boxes: a closed surface mesh, an STL, OBJ, PLY or MSH file, homogeneous inside. The payload's
            frame is the frame of the mesh.
        density: Density of the mesh [kg/m³].
        mass: Mass of the mesh, instead of its density [kg].
        scale: Length of the mesh's unit [m]: 0.001 if it was drawn in millimetres.
        load_slots: Largest number of loads on it at a time.
        surface: Shape for views, filled in when a file is read; leave it out.
    """

    boxes: tuple[Box, ...] = ()
    properties: MassProperties | None = None
    mjcf: str | None = None
    body: str | None = None
    mesh: str | None = None
    density: Positive | None = None
    mass: Positive | None = None
    scale: Positive = 1.0
    load_slots: Annotated[int, Meta(ge=0, le=64)] = 4
    surface: str = ""

    def inertia(self) -> Inertia:
        """Return the mass properties in the payload's frame, without loads."""
        return self.properties.inertia() if self.properties else combined(box.inertia() for box in self.boxes)


def vector_of(values: Array) -> Vector:
    """Convert three numbers (3,) to the type of a scenario's vectors."""
    x, y, z = values.tolist()
    return x, y, z

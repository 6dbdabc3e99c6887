"""Common parts of all sections of a scenario."""

from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from coheft.estimation.geometry.spatial import Pose, rotation_exp
from coheft.estimation.measurement import Positive

Vector = tuple[float, float, float]
NotNegative = Annotated[float, Meta(ge=0)]
Seed = Annotated[int, Meta(ge=0, lt=2**32)]
Name = Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_-]{0,31}\Z")]
Names = Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_-]{0,31}(, *[a-z][a-z0-9_-]{0,31})*\Z")]
"""One or several names, with commas between them."""
NAME_IN_WORDS = "text: a lower-case letter, then up to 31 lower-case letters, digits, - or _"
"""Description of a valid ``Name``."""
Lengths = tuple[Positive, Positive, Positive]


class Section(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base class of all sections of a scenario: unknown keys are errors."""


def pose_of(position: Vector, rotation_deg: Vector) -> Pose:
    """Make a pose from a position [m] and a rotation vector [degrees]."""
    return Pose(rotation_exp(np.radians(rotation_deg)), np.array(position, dtype=np.float64))

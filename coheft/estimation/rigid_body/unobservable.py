"""Unobservable parts of mass, centre of mass and inertia in words, and an estimate of a load's size."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from coheft.estimation.geometry.observability import axis_in_words
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.mass_properties import TIMES_IN_MATRIX, pack_symmetric, unpack_symmetric

_RELATIVE_STD = 0.3
"""Parameters with a standard deviation above this share of their scale are not published."""
_SMALLEST = 0.25
"""Smallest size that is assumed for a load [m]."""

Quantity = Literal["mass", "com", "inertia"]


@dataclass(frozen=True, eq=False)
class Unobservable:
    """A parameter that is not observable from the motion so far.

    Attributes:
        quantity: The quantity to which it belongs.
        what: Description, with axes in the frame of the estimate.
        remedy: A motion that makes it observable.
    """

    quantity: Quantity
    what: str
    remedy: str


def middle_and_size(poses: Sequence[Pose]) -> tuple[Array, float]:
    """Return the middle (3,) of the grasps, and their root mean square distance to it, as an estimate of the load's
    place and size [m].

    A large load may be held in one place: too small a size would give too much confidence, too large a size only costs
    time.
    """
    places = np.array([pose.translation for pose in poses])
    middle: Array = places.mean(axis=0)
    return middle, max(float(np.sqrt(np.square(places - middle).sum(axis=1).mean())), _SMALLEST)


def unobservable_quantities(covariance: Array, mass: float, length: float) -> tuple[Unobservable, ...]:
    """Describe the directions of ``(m, h, J)`` whose uncertainty is too large.

    Args:
        covariance: Covariance of ``(m, h, J)``, ``J`` packed, shape (10, 10).
        mass: Rough mass [kg].
        length: Rough size of the body [m].
    """
    found = []
    limit = (_RELATIVE_STD * mass * length**2) ** 2
    is_com_seen = np.trace(covariance[1:4, 1:4]) <= (_RELATIVE_STD * length) ** 2
    # No moment about an axis is more uncertain than 5/3 of the largest eigenvalue.
    if is_com_seen and covariance[0, 0] <= (_RELATIVE_STD * mass) ** 2 and np.trace(covariance[4:, 4:]) <= 0.6 * limit:
        return ()
    if covariance[0, 0] > (_RELATIVE_STD * mass) ** 2:
        found.append(
            Unobservable("mass", "mass", "accelerate the load, or let gravity act on it in different directions")
        )

    values, axes = np.linalg.eigh(covariance[1:4, 1:4])
    hidden = [axis for value, axis in zip(values, axes.T, strict=True) if value > (_RELATIVE_STD * length) ** 2]
    for what in _named("centre of mass", "along", hidden):
        found.append(Unobservable("com", what, "tilt the load, or turn it about an axis across that direction"))

    values, vectors = np.linalg.eigh(covariance[4:, 4:])
    matrices = unpack_symmetric(vectors.T[values > limit])
    # A body that only turns about u shows J u: the unobservable part is symmetric and has u in its null space.
    _, axes = np.linalg.eigh(np.einsum("kij,kjl->il", matrices, matrices))
    moments = pack_symmetric(axes.T[:, :, None] * axes.T[:, None, :]) * TIMES_IN_MATRIX
    variances = np.einsum("ki,ij,kj->k", moments, covariance[4:, 4:], moments)
    hidden = [axis for variance, axis in zip(variances, axes.T, strict=True) if variance > limit]
    for what in _named("inertia", "about", hidden):
        remedy = "turn the load" if len(hidden) == 3 else "turn the load faster about that axis"
        found.append(Unobservable("inertia", what, remedy))
    if len(matrices) and not hidden:
        found.append(Unobservable("inertia", "products of inertia", "turn the load about all axes"))
    return tuple(found)


def _named(quantity: str, preposition: str, axes: list[Array]) -> list[str]:
    if len(axes) == 3:
        return [quantity]
    return [f"{quantity} {preposition} {axis_in_words(axis)}" for axis in axes]

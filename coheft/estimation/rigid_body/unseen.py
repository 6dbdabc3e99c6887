"""What of mass, centre of mass and inertia is not seen yet, in words, and how large a load may be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.mass_properties import TIMES_IN_MATRIX, pack_symmetric, unpack_symmetric

_SEEN = 0.3
"""No number is claimed for what has a standard deviation above this share of its scale."""
_SMALLEST = 0.25
"""No load is guessed to be smaller [m]."""

Quantity = Literal["mass", "com", "inertia"]


@dataclass(frozen=True, eq=False)
class Unseen:
    """Something that the motion so far does not show.

    Attributes:
        quantity: It is part of this.
        what: In words, axes in the coordinates of the estimate's frame.
        remedy: A motion that would show it.
    """

    quantity: Quantity
    what: str
    remedy: str


def middle_and_size(poses: Sequence[Pose]) -> tuple[Array, float]:
    """About where the load is, and how large [m]: middle (3,) of the grasps, and their root mean square distance to it.

    A large load may be held in one place: what is guessed too small would be trusted too much, and one that is guessed
    too large only costs time until all is seen.
    """
    places = np.array([pose.translation for pose in poses])
    middle: Array = places.mean(axis=0)
    return middle, max(float(np.sqrt(np.square(places - middle).sum(axis=1).mean())), _SMALLEST)


def unseen_quantities(covariance: Array, mass: float, length: float) -> tuple[Unseen, ...]:
    """Name the directions of ``(m, h, J)`` that are too uncertain to be called seen.

    Args:
        covariance: Of ``(m, h, J)``, ``J`` packed, shape (10, 10).
        mass: Rough mass [kg].
        length: Rough size of the body [m].
    """
    found = []
    limit = (_SEEN * mass * length**2) ** 2
    is_com_seen = np.trace(covariance[1:4, 1:4]) <= (_SEEN * length) ** 2
    # No moment about an axis is more uncertain than 5/3 of the largest eigenvalue.
    if is_com_seen and covariance[0, 0] <= (_SEEN * mass) ** 2 and np.trace(covariance[4:, 4:]) <= 0.6 * limit:
        return ()
    if covariance[0, 0] > (_SEEN * mass) ** 2:
        found.append(Unseen("mass", "mass", "accelerate the load, or let gravity act on it in different directions"))

    values, axes = np.linalg.eigh(covariance[1:4, 1:4])
    hidden = [axis for value, axis in zip(values, axes.T, strict=True) if value > (_SEEN * length) ** 2]
    for what in _named("centre of mass", "along", hidden):
        found.append(Unseen("com", what, "tilt the load, or turn it about an axis across that direction"))

    values, vectors = np.linalg.eigh(covariance[4:, 4:])
    matrices = unpack_symmetric(vectors.T[values > limit])
    # A body that only turns about u shows J u: what is hidden is symmetric and has u in its null space.
    _, axes = np.linalg.eigh(np.einsum("kij,kjl->il", matrices, matrices))
    moments = pack_symmetric(axes.T[:, :, None] * axes.T[:, None, :]) * TIMES_IN_MATRIX
    variances = np.einsum("ki,ij,kj->k", moments, covariance[4:, 4:], moments)
    hidden = [axis for variance, axis in zip(variances, axes.T, strict=True) if variance > limit]
    for what in _named("inertia", "about", hidden):
        remedy = "turn the load" if len(hidden) == 3 else "turn the load faster about that axis"
        found.append(Unseen("inertia", what, remedy))
    if len(matrices) and not hidden:
        found.append(Unseen("inertia", "products of inertia", "turn the load about all axes"))
    return tuple(found)


def _named(quantity: str, preposition: str, axes: list[Array]) -> list[str]:
    if len(axes) == 3:
        return [quantity]
    # The sign of an axis means nothing: let its largest component be positive.
    signed = [axis * np.sign(axis[np.argmax(np.abs(axis))]) for axis in axes]
    return [f"{quantity} {preposition} ({x:.2f}, {y:.2f}, {z:.2f})" for x, y, z in np.round(signed, 2) + 0.0]

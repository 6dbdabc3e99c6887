"""Which parts of a pose the data have not shown yet, and how to say so."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.geometry.uncertain_pose import UncertainPose

_FLOOR = 1e-6
"""Share of the required information that unseen directions are given, so that covariances stay finite."""
_DOUBT = 5.0
"""Standard deviations of the noise in the information by which a direction must exceed it to count as seen."""
_PURE = 0.1
"""A direction is called a rotation, or a translation, when the other part is below this share of it."""


@dataclass(frozen=True)
class Visibility:
    """Standard deviations above which a direction counts as not seen.

    Attributes:
        rotation: [rad].
        translation: [m].
    """

    rotation: float = np.radians(5.0)
    translation: float = 0.1

    def scale(self) -> Array:
        """Per component of a pose's perturbation ``(rotation, translation)``, shape (6,)."""
        return np.array([self.rotation] * 3 + [self.translation] * 3)


@dataclass(frozen=True, eq=False)
class UnseenDirection:
    """A motion of the estimated frame that the data do not tell from none.

    Attributes:
        rotation: Shape (3,), in the axes of the frame that the pose is given in, in units of the limit.
        translation: Shape (3,), likewise; both together have norm 1.
    """

    rotation: Array
    translation: Array

    def __str__(self) -> str:
        parts = []
        for name, vector in (("rotation about", self.rotation), ("translation along", self.translation)):
            if np.linalg.norm(vector) > _PURE:
                x, y, z = _axis(vector)
                parts.append(f"{name} ({x:.2f}, {y:.2f}, {z:.2f})")
        return " with ".join(parts)


@dataclass(frozen=True, eq=False)
class PoseEstimate(UncertainPose):
    """A pose, how well it is known, and what is not.

    Attributes:
        unseen: Directions that the motion has not shown yet: along them the pose is arbitrary and the covariance
            means nothing.
    """

    unseen: tuple[UnseenDirection, ...]


@dataclass(frozen=True, eq=False)
class SeenInformation:
    """Information on one or several poses, divided into directions that were seen and others.

    Attributes:
        values: Eigenvalues in units of what is required, shape (6 k,), those of unseen directions first.
        directions: As columns, what each belongs to, in units [rad, m], shape (6 k, 6 k).
        unseen_count: Number of unseen directions.
        limits: What is required.
    """

    values: Array
    directions: Array
    unseen_count: int
    limits: Visibility

    def inverse(self) -> Array:
        """Inverse of the information; unseen directions get 1000 times the limit, a stand-in for infinity."""
        values = np.concatenate([np.full(self.unseen_count, _FLOOR), self.values[self.unseen_count :]])
        result: Array = (self.directions / values) @ self.directions.T
        return result

    def unseen(self) -> tuple[UnseenDirection, ...]:
        """The unseen directions of a single pose, as pure as they come."""
        basis = self.directions[:, : self.unseen_count] / self.limits.scale()[:, None]
        return tuple(UnseenDirection(column[:3], column[3:]) for column in _named_basis(basis).T)


def seen_information(information: Array, limits: Visibility) -> SeenInformation:
    """Divide the information on k poses by what has been seen of them.

    Args:
        information: Of the perturbations ``(rotation, translation)``, shape (6 k, 6 k), symmetric; need not be
            definite.
        limits: When a direction counts as seen.
    """
    scale = np.concatenate([limits.scale()] * (len(information) // 6))
    scales = scale[:, None] * scale
    values, vectors = np.linalg.eigh(information * scales)
    return SeenInformation(values, scale[:, None] * vectors, int((values < 1.0).sum()), limits)


def doubt_of(noise: Array, count: float) -> Array:
    """Part of an information that may be noise beside what of it is due to noise on average; shape of ``noise``.

    Args:
        noise: What of the information is due to noise on average, of any shape.
        count: Number of samples that it is of; their noise is independent.
    """
    result: Array = _DOUBT / np.sqrt(max(count, 1.0)) * noise
    return result


def _named_basis(basis: Array) -> Array:
    """The same subspace, shape (6, k), spanned by pure rotations and pure translations as far as it holds them."""
    if basis.shape[1] == 0:
        return basis
    _, shares, turn = np.linalg.svd(basis[:3])
    turned: Array = basis @ turn.T
    shares = np.concatenate([shares, np.zeros(basis.shape[1] - len(shares))])
    for rows, pure in ((slice(0, 3), shares > 1.0 - _PURE**2), (slice(3, 6), shares < _PURE)):
        if np.sum(pure) == 3:  # All axes alike: name the frame's own.
            turned[:, pure] = 0.0
            turned[rows, pure] = np.eye(3)
    return turned


def _axis(vector: Array) -> Array:
    """Unit vector along, its largest component positive; no negative zeros."""
    unit = vector / np.linalg.norm(vector)
    unit = unit * np.sign(unit[np.argmax(np.abs(unit))])
    result: Array = np.round(unit, 2) + 0.0
    return result

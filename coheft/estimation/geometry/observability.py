"""Observability of poses: which directions the data do not show, and their description."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.geometry.uncertain_pose import UncertainPose

LIMITS = np.repeat([np.radians(5.0), 0.1], 3)
"""Standard deviations of ``(rotation, translation)`` above which a direction counts as unobservable [rad, m]."""
_FLOOR = 1e-6
"""Share of the required information that is assigned to unobservable directions, so that covariances stay finite."""
_DOUBT = 5.0
"""Standard deviations of the noise in the information by which a direction must exceed it to count as observable."""
_PURE = 0.1
"""A direction is called a rotation, or a translation, if the other part is below this share of it."""


@dataclass(frozen=True, eq=False)
class UnobservableDirection:
    """A motion of the estimated frame that the data cannot distinguish from no motion.

    rotation: Shape (3,), in the axes of the frame in which the pose is given, in units of the limit.
    translation: Shape (3,), in the same axes and units of its limit; both together have norm 1.
    """

    rotation: Array
    translation: Array

    def __str__(self) -> str:
        parts = []
        for name, vector in (("rotation about", self.rotation), ("translation along", self.translation)):
            if np.linalg.norm(vector) > _PURE:
                parts.append(f"{name} {axis_in_words(vector)}")
        return " with ".join(parts)


@dataclass(frozen=True, eq=False)
class PoseEstimate(UncertainPose):
    """A pose with its covariance and its unobservable directions.

    Attributes:
        unobservable: Directions that the motion has not shown yet: along these the pose is arbitrary and the covariance
            is meaningless.
    """

    unobservable: tuple[UnobservableDirection, ...]


@dataclass(frozen=True, eq=False)
class SeenInformation:
    """Information on a pose, divided into observable and unobservable directions.

    Attributes:
        values: Eigenvalues in units of the required information, shape (6,), those of unobservable directions first.
        directions: Their directions as columns, in units [rad, m], shape (6, 6).
        unobservable_count: Number of unobservable directions.
    """

    values: Array
    directions: Array
    unobservable_count: int

    @staticmethod
    def of(information: Array) -> SeenInformation:
        """Divide the information (6, 6) on a perturbation, symmetric, not necessarily definite."""
        values, vectors = np.linalg.eigh(information * np.outer(LIMITS, LIMITS))
        return SeenInformation(values, LIMITS[:, None] * vectors, int((values < 1.0).sum()))

    def inverse(self) -> Array:
        """Return the inverse of the information; unobservable directions get 1000 times the limit in place of
        infinity.
        """
        values = np.concatenate([np.full(self.unobservable_count, _FLOOR), self.values[self.unobservable_count :]])
        result: Array = (self.directions / values) @ self.directions.T
        return result

    def unobservable(self) -> tuple[UnobservableDirection, ...]:
        """Return the unobservable directions, separated into rotations and translations if possible."""
        basis = self.directions[:, : self.unobservable_count] / LIMITS[:, None]
        return tuple(UnobservableDirection(column[:3], column[3:]) for column in _named_basis(basis).T)


def doubt_of(noise: Array, count: float) -> Array:
    """Return the part of an information that may be noise in excess of its mean due to noise; shape of ``noise``.

    Args:
        noise: Mean of the information due to noise, of any shape.
        count: Number of samples with independent noise.
    """
    result: Array = _DOUBT / np.sqrt(max(count, 1.0)) * noise
    return result


def _named_basis(basis: Array) -> Array:
    """Return a basis of the same subspace, shape (6, k), of pure rotations and pure translations as far as possible."""
    if basis.shape[1] == 0:
        return basis
    _, shares, turn = np.linalg.svd(basis[:3])
    turned: Array = basis @ turn.T
    shares = np.concatenate([shares, np.zeros(basis.shape[1] - len(shares))])
    for rows, pure in ((slice(0, 3), shares > 1.0 - _PURE**2), (slice(3, 6), shares < _PURE)):
        if np.sum(pure) == 3:  # all axes are equivalent: use the frame's own
            turned[:, pure] = 0.0
            turned[rows, pure] = np.eye(3)
    return turned


def axis_in_words(vector: Array) -> str:
    """Return an axis (3,) of any length and sign as text; its largest component is positive."""
    unit = vector / np.linalg.norm(vector)
    x, y, z = np.round(unit * np.sign(unit[np.argmax(np.abs(unit))]), 2) + 0.0  # without negative zeros
    return f"({x:.2f}, {y:.2f}, {z:.2f})"

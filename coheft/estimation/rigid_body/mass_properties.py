"""Mass properties of a rigid body in any frame, and its equations of motion.

A symmetric 3x3 inertia ``J`` is packed as ``(xx, yy, zz, xy, xz, yz)``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from coheft.estimation.geometry.spatial import Array, Pose, skew

PACKED_ROWS, PACKED_COLUMNS = np.array([0, 1, 2, 0, 0, 1]), np.array([0, 1, 2, 1, 2, 2])
"""Indices of the packed entries of a symmetric 3x3 matrix."""
_PLACES = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])


def pack_symmetric(matrix: Array) -> Array:
    """Return ``(xx, yy, zz, xy, xz, yz)`` of symmetric matrices, shape (..., 3, 3) to (..., 6)."""
    packed: Array = matrix.reshape(*matrix.shape[:-2], 9).take(3 * PACKED_ROWS + PACKED_COLUMNS, axis=-1)
    return packed


def unpack_symmetric(packed: Array) -> Array:
    """Return the symmetric matrices of packed ones, shape (..., 6) to (..., 3, 3)."""
    return packed.take(_PLACES, axis=-1)


TIMES_IN_MATRIX: Array = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
"""Multiplicity of each packed element: ``packed**2 @ TIMES_IN_MATRIX`` is the squared Frobenius norm of the matrix."""
_OF_ELEMENTS = unpack_symmetric(np.eye(6)).reshape(18, 3).T


def inertia_operator(x: npt.ArrayLike) -> Array:
    """Return ``Om(x)`` with ``Om(x) @ pack_symmetric(J) == J @ x``.

    Args:
        x: Vectors, shape (..., 3).

    Returns:
        Shape (..., 3, 6).
    """
    x = np.asarray(x, dtype=np.float64)
    # J @ x is linear in x: one matrix (6, 3) for each of J's packed elements.
    return (x @ _OF_ELEMENTS).reshape(*x.shape[:-1], 6, 3).swapaxes(-1, -2)


def euler_regressor(w: Array, alpha: Array) -> Array:
    """Return ``Om(alpha) + [w]x Om(w)``, which gives Euler's ``J alpha + w x J w`` (Fan et al., eq. 30).

    Args:
        w: Angular velocity in the axes of ``J``, shape (..., 3) [rad/s].
        alpha: Angular acceleration, shape (..., 3) [rad/s²].

    Returns:
        Shape (..., 3, 6).
    """
    return inertia_operator(alpha) + skew(w) @ inertia_operator(w)


def unit_point(place: Array) -> Array:
    """Return the packed inertia about the origin of 1 kg at ``place``: ``|p|^2 1 - p p^T``, (..., 3) to (..., 6)."""
    products = place[..., PACKED_ROWS] * place[..., PACKED_COLUMNS]
    packed: Array = -products
    packed[..., :3] += products[..., :3].sum(axis=-1, keepdims=True)
    return packed


def point_mass(place: Array) -> Array:
    """``(m, m h, I_o)`` of a mass of 1 kg at ``place``, shape (..., 3) to (..., 10)."""
    return np.concatenate([np.ones((*place.shape[:-1], 1)), place, unit_point(place)], axis=-1)


def packed_rotation(rotation: Array) -> Array:
    """Return ``K(R)`` (6, 6) with ``K(R) @ pack_symmetric(J) == pack_symmetric(R @ J @ R.T)``."""
    turned = rotation @ unpack_symmetric(np.eye(6)) @ rotation.T
    return pack_symmetric(turned).T


def pseudo_inertia(parameters: Array) -> Array:
    """Return the pseudo-inertia ``[[Sigma, m h], [m h^T, m]]`` of ``(m, m h, I_o)``, shape (..., 10) to (..., 4, 4).

    ``Sigma`` is the second moment of mass about the frame's origin (Wensing, Kim, Slotine 2017).
    """
    about_origin = unpack_symmetric(parameters[..., 4:10])
    half_trace = 0.5 * np.trace(about_origin, axis1=-2, axis2=-1)
    matrix = np.empty((*parameters.shape[:-1], 4, 4))
    matrix[..., :3, :3] = half_trace[..., None, None] * np.eye(3) - about_origin
    matrix[..., :3, 3] = matrix[..., 3, :3] = parameters[..., 1:4]
    matrix[..., 3, 3] = parameters[..., 0]
    return matrix


@dataclass(frozen=True, eq=False)
class Inertia:
    """Mass properties of a rigid body in some frame ``F_i``.

    Attributes:
        mass: ``m`` [kg].
        com: Centre of mass ``h_i`` in ``F_i``, shape (3,) [m].
        tensor: ``J_i``, inertia **about the centre of mass** in the axes of ``F_i``, shape (3, 3) [kg·m²].
    """

    mass: float
    com: Array
    tensor: Array

    @staticmethod
    def of_box(mass: float, size: npt.ArrayLike, pose: Pose) -> Inertia:
        """Make the inertia of a homogeneous box with edge lengths ``size`` (3,) [m], centred at ``pose``."""
        squares = np.square(np.asarray(size, dtype=np.float64))
        tensor = np.diag(mass / 12.0 * (squares.sum() - squares))
        return Inertia(mass, np.zeros(3), tensor).transported(pose)

    @staticmethod
    def from_barycentric(parameters: npt.ArrayLike) -> Inertia:
        """Make an inertia from its ``barycentric`` parameters."""
        parameters = np.asarray(parameters, dtype=np.float64)
        mass = float(parameters[0])
        com = parameters[1:4] / mass
        return Inertia(mass, com, unpack_symmetric(parameters[4:] - mass * unit_point(com)))

    def barycentric(self) -> Array:
        """Return ``(m, m h, I_o)``, shape (10,), with ``I_o`` about the frame's origin: the dynamics are linear in
        these.
        """
        about_origin = pack_symmetric(self.tensor) + self.mass * unit_point(self.com)
        return np.concatenate([[self.mass], self.mass * self.com, about_origin])

    def central(self) -> Array:
        """Return ``(m, h, J)``, shape (10,), with ``J`` packed."""
        return np.concatenate([[self.mass], self.com, pack_symmetric(self.tensor)])

    def transported(self, pose_j_in_i: Pose) -> Inertia:
        """Transform from ``F_j`` to ``F_i``: ``h_i = R h_j + p``, ``J_i = R J_j R^T``."""
        rotation = pose_j_in_i.rotation
        return Inertia(self.mass, pose_j_in_i.apply(self.com), rotation @ self.tensor @ rotation.T)

    def spatial(self) -> Array:
        """Return the 6x6 inertia that maps a twist ``(w, v)`` of ``F_i`` to momentum ``(angular about origin,
        linear)``.
        """
        moment = self.mass * skew(self.com)
        about_origin = self.tensor - moment @ skew(self.com)
        return np.block([[about_origin, moment], [-moment, self.mass * np.eye(3)]])

    def pseudo_inertia(self) -> Array:
        """Return the 4x4 pseudo-inertia; a body can exist if and only if it is positive semi-definite."""
        return pseudo_inertia(self.barycentric())

    def wrench(self, w: Array, a: Array, alpha: Array) -> Array:
        """Return the total wrench ``(F, T)`` about the frame's origin for a motion (Newton-Euler).

        Args:
            w: Angular velocity in ``F_i``, shape (..., 3) [rad/s].
            a: Proper acceleration of the frame's origin, shape (..., 3) [m/s²].
            alpha: Angular acceleration, shape (..., 3) [rad/s²].

        Returns:
            ``F = m (a + alpha x h + w x (w x h))`` and ``T = J alpha + w x J w + h x F``, shape (..., 6).
        """
        h, tensor = self.com, self.tensor
        force = self.mass * (a + np.cross(alpha, h) + np.cross(w, np.cross(w, h)))
        torque = alpha @ tensor + np.cross(w, w @ tensor) + np.cross(h, force)
        return np.concatenate([force, torque], axis=-1)


def edges_of_box(mass: float, moments: Array) -> Array:
    """Return the edges (3,) [m] of the homogeneous box with principal moments ``I_k``, (3,); 0 where no box has them.

    ``a_k^2 = 6 (I_i + I_j - I_k) / m``.
    """
    edges: Array = np.sqrt(np.maximum(6.0 / mass * (moments.sum() - 2.0 * moments), 0.0))
    return edges


def combined(bodies: Iterable[Inertia]) -> Inertia:
    """Return the inertia of bodies that are fixed to each other, all given in one frame."""
    return Inertia.from_barycentric(np.sum([body.barycentric() for body in bodies], axis=0))

"""Randomly drawn vectors, poses and rigid motions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp, skew

GRAVITY = np.array([0.0, 0.0, -9.81])


def vectors(bound: float, size: int = 3) -> st.SearchStrategy[Array]:
    return arrays(np.float64, size, elements=st.floats(-bound, bound, allow_subnormal=False))


def _unit(vector: Array) -> Array:
    result: Array = vector / np.linalg.norm(vector)
    return result


axes = vectors(1.0).filter(lambda x: bool(np.linalg.norm(x) > 1e-3)).map(_unit)
angles = st.one_of(st.floats(0.0, np.pi), st.floats(0.0, 1e-3), st.floats(np.pi - 1e-3, np.pi))
rotation_vectors = st.builds(lambda angle, axis: angle * axis, angles, axes)
"""Of every angle, with those near 0 and near pi drawn often."""
rotations = rotation_vectors.map(rotation_exp)
poses = st.builds(Pose, rotations, vectors(2.0))
quaternions = vectors(1.0, 4).filter(lambda q: bool(np.linalg.norm(q) > 1e-3)).map(_unit)


@dataclass(frozen=True, eq=False)
class RigidMotion:
    """A moment of a body's motion, as derivatives of its pose ``(R, p)`` in the world: the definition of all sensors.

    Attributes:
        rotation: ``R``.
        w: Angular velocity in the body's axes, ``R' = R [w]x``.
        alpha: Its derivative, ``R'' = R ([w]x^2 + [alpha]x)``.
        velocity: ``p'``.
        acceleration: ``p''``.
    """

    rotation: Array
    w: Array
    alpha: Array
    velocity: Array
    acceleration: Array

    def proper_acceleration(self, point: Array) -> Array:
        """Of a point of the body (3,), in the body's axes: ``R^T (p'' + R'' x - g)``."""
        second = self.rotation @ (skew(self.w) @ skew(self.w) + skew(self.alpha))
        result: Array = self.rotation.T @ (self.acceleration + second @ point - GRAVITY)
        return result

    def sensed(self, pose_i_in_body: Pose) -> tuple[Array, Array, Array, Array]:
        """``w, v, a`` and ``alpha`` in a frame fixed to the body."""
        to_i, point = pose_i_in_body.rotation.T, pose_i_in_body.translation
        velocity = self.rotation.T @ self.velocity + skew(self.w) @ point
        return to_i @ self.w, to_i @ velocity, to_i @ self.proper_acceleration(point), to_i @ self.alpha


motions = st.builds(RigidMotion, rotations, vectors(3.0), vectors(20.0), vectors(1.0), vectors(10.0))


@dataclass(frozen=True, eq=False)
class Particles:
    """A body of point masses.

    Attributes:
        masses: Shape (n,) [kg].
        positions: In the body's frame, shape (n, 3) [m].
    """

    masses: Array
    positions: Array

    def com(self) -> Array:
        result: Array = self.masses @ self.positions / self.masses.sum()
        return result

    def tensor(self) -> Array:
        """Inertia at the centre of mass."""
        offsets = skew(self.positions - self.com())
        return -np.einsum("n,nij,njk->ik", self.masses, offsets, offsets)

    def seen_from(self, pose_i_in_body: Pose) -> Particles:
        return Particles(self.masses, pose_i_in_body.inverse().apply(self.positions))

    def wrench(self, motion: RigidMotion, pose_i_in_body: Pose) -> Array:
        """What has to act on the body, about the origin of ``F_i``: Newton's law, particle by particle."""
        accelerations = [motion.proper_acceleration(position) for position in self.positions]
        forces = self.masses[:, None] * np.array(accelerations) @ pose_i_in_body.rotation
        arms = self.seen_from(pose_i_in_body).positions
        return np.concatenate([forces.sum(axis=0), np.cross(arms, forces).sum(axis=0)])


bodies = st.builds(
    Particles,
    arrays(np.float64, 5, elements=st.floats(0.1, 5.0)),
    arrays(np.float64, (5, 3), elements=st.floats(-1.0, 1.0, allow_subnormal=False)),
)

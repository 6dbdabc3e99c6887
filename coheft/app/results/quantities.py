"""The quantities that are evaluated, and norms of the errors of all robots."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from coheft.app.results.errors import PAYLOAD_SIZE, in_full, payload_error
from coheft.app.results.judge import Judge
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.consistency import is_possible
from coheft.estimation.rigid_body.mass_properties import TIMES_IN_MATRIX, Inertia
from coheft.wire.messages.structs import Estimate, PayloadEstimate

_ROUNDING = 1e-9
Edges = Sequence[tuple[str, str]]
"""Ordered pairs (i, j) of neighbours: i estimates ``pose_j_in_i``."""


@dataclass(frozen=True, eq=False)
class Quantity:
    """Some components of the error of a pose ``(rotation vector, translation)`` or a payload ``(m, h, J packed)``.

    Attributes:
        of_payload: Whether it is a part of the payload; otherwise it is a part of a pose.
        components: Its components of the error.
        counts: Weight of each component in the square of the norm.
    """

    name: str
    unit: str
    of_payload: bool
    components: slice
    counts: Array

    def squares(self, errors: Array) -> Array:
        """Return squared norms of errors, shape (k, 6 or 10) to (k,)."""
        return np.square(errors[:, self.components]) @ self.counts

    def expected_squares(self, covariances: Array) -> Array:
        """Return the expectation of ``squares`` for given covariances, shape (k, s, s) to (k,)."""
        return np.diagonal(covariances, axis1=1, axis2=2)[:, self.components] @ self.counts


_ONCE = np.ones(3)
QUANTITIES = (
    Quantity("pose_rotation", "rad", False, slice(0, 3), _ONCE),
    Quantity("pose_translation", "m", False, slice(3, 6), _ONCE),
    Quantity("mass", "kg", True, slice(0, 1), np.ones(1)),
    Quantity("com", "m", True, slice(1, 4), _ONCE),
    Quantity("inertia", "kg·m²", True, slice(4, 10), TIMES_IN_MATRIX),
)
UNITS = {quantity.name: quantity.unit for quantity in QUANTITIES}
ALL_TEN = Quantity("all_ten", "", True, slice(0, PAYLOAD_SIZE), np.ones(PAYLOAD_SIZE))


@dataclass(frozen=True, eq=False)
class TeamArrays:
    """Errors or covariances of all poses and of the payload as seen by all robots.

    Attributes:
        poses: Of all edges: rotation vector in the axes of ``F_i`` [rad] and translation [m], shape (edges, 6 or 6, 6).
        payload: Of all robots: ``(m, h, J packed)`` in ``F_i``, shape (N, 10 or 10, 10).
    """

    poses: Array
    payload: Array

    def of(self, quantity: Quantity) -> Array:
        """Return the array that a quantity belongs to."""
        return self.payload if quantity.of_payload else self.poses


@dataclass(frozen=True, eq=False)
class Errors(TeamArrays):
    """Errors at one time, truth minus estimate, with the robots' own covariances; NaN where there is no estimate."""

    covariances: TeamArrays


def directed_edges(neighbours: Mapping[str, Sequence[str]]) -> list[tuple[str, str]]:
    """Return all ordered pairs of neighbours."""
    return [(name, other) for name in sorted(neighbours) for other in sorted(neighbours[name])]


def published_errors(judge: Judge, edges: Edges, estimates: Mapping[str, Estimate]) -> Errors:
    """Return the errors of all robots' published estimates, each at its own last block."""
    names = judge.scene.robots
    poses, pose_covariances = np.full((len(edges), 6), np.nan), np.full((len(edges), 6, 6), np.nan)
    payload, payload_covariances = np.full((len(names), 10), np.nan), np.full((len(names), 10, 10), np.nan)
    pose_errors = {name: judge.pose_errors(estimate) for name, estimate in estimates.items()}
    for k, (name, other) in enumerate(edges):
        if other in pose_errors.get(name, ()):
            poses[k], pose_covariances[k] = pose_errors[name][other], estimates[name].poses[other].covariance
    for k, name in enumerate(names):
        if name in estimates and (believed := estimates[name].payload) is not None:
            payload[k] = in_full(payload_error(judge.payload(name, estimates[name].block), believed))
            payload_covariances[k] = in_full(believed.covariance)
    return Errors(poses, payload, TeamArrays(pose_covariances, payload_covariances))


def payload_exists(payload: PayloadEstimate | None) -> bool:
    """Whether a body with these mass properties can exist; true if there is no estimate."""
    if payload is None:
        return True
    if payload.com is None or payload.tensor is None:
        return payload.mass > 0.0
    return is_possible(Inertia(payload.mass, payload.com, payload.tensor).barycentric(), -_ROUNDING)

"""From information to an estimate: mass, centre of mass and inertia, how certain they are, and what is not seen yet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from coheft.estimation.consistency import is_possible, nearest_possible
from coheft.estimation.inertia import INERTIA_SIZE, InertiaInformation
from coheft.estimation.inertia_derivatives import central_derivative
from coheft.estimation.rigid_body import TIMES_IN_MATRIX, Inertia, pack_symmetric, unit_point, unpack_symmetric
from coheft.estimation.spatial import Array, Pose

_GRAVITY = 9.81
_SEEN = 0.3
"""No number is claimed for what has a standard deviation above this share of its scale."""
_SIGNAL = 0.3
"""Data are trusted only in directions where at least this share of the information is motion, and not its noise."""

_SMALLEST = 0.25
"""No load is guessed to be smaller [m]."""
_GUESSES = 3
_GOOD_GUESS = 1e-3
"""A mass that was guessed so well need not be guessed again."""
_LIGHTEST = 1e-3
"""Least mass that is guessed [kg]."""


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


@dataclass(frozen=True, eq=False)
class InertiaEstimate:
    """An estimate, in the frame of the information that it follows from.

    Attributes:
        inertia: Always physically possible. Where something is unseen it holds the guess.
        covariance: Of ``(m, h, J)`` [kg, m, kg·m²] with ``J`` packed, at the centre of mass, shape (10, 10).
        to_central: Derivative of ``(m, h, J)`` by ``theta``, shape (10, 10).
        parameters: ``theta = (m, m h, I_o)`` as it was solved for, shape (10,): not forced to be possible.
        parameters_covariance: Of ``theta``, shape (10, 10).
        offset: Constant excess ``(F_0, T_0)`` of the total wrench [N, N·m], shape (6,), or None if not estimated.
        unseen: What no number should be claimed for.
    """

    inertia: Inertia
    covariance: Array
    to_central: Array
    parameters: Array
    parameters_covariance: Array
    offset: Array | None
    unseen: tuple[Unseen, ...]


def middle_and_size(poses: Sequence[Pose]) -> tuple[Array, float]:
    """About where the load is, and how large [m]: middle (3,) of the grasps, and their root mean square distance to it.

    A large load may be held in one place: what is guessed too small would be trusted too much, and one that is guessed
    too large only costs time until all is seen.
    """
    places = np.array([pose.translation for pose in poses])
    middle: Array = places.mean(axis=0)
    return middle, max(float(np.sqrt(np.square(places - middle).sum(axis=1).mean())), _SMALLEST)


@dataclass(frozen=True, eq=False)
class InertiaSolution:
    """Weighted least squares together with a guess; not forced to be possible.

    Attributes:
        parameters: ``theta``, shape (10,).
        covariance: Of ``theta`` by noise, shape (10, 10).
        offset: As of ``InertiaEstimate``.
        length: Rough size of the body [m].
    """

    parameters: Array
    covariance: Array
    offset: Array | None
    length: float

    def made_possible(self, doubt: Array | None = None) -> InertiaEstimate:
        """The nearest possible body, in the metric of all errors, not of the noise alone.

        A little of another error may put ``theta`` many deviations of the noise outside what is possible; the way back
        that is nearest in the metric of the noise leads far away from the truth.

        Args:
            doubt: Covariance of ``theta`` by all else, shape (10, 10). It is not in the result's ``covariance``.
        """
        possible = self.parameters
        if not is_possible(possible):
            errors = self.covariance if doubt is None else self.covariance + doubt
            possible = nearest_possible(possible, np.linalg.inv(errors).astype(np.float64), self.length)
        inertia = Inertia.from_barycentric(possible)
        to_central = central_derivative(inertia)
        covariance = to_central @ self.covariance @ to_central.T
        return InertiaEstimate(
            inertia=inertia,
            covariance=covariance,
            to_central=to_central,
            parameters=self.parameters,
            parameters_covariance=self.covariance,
            offset=self.offset,
            unseen=unseen_quantities(covariance, max(float(self.parameters[0]), _LIGHTEST), self.length),
        )


def solve_inertia(information: InertiaInformation, centre: Array, length: float) -> InertiaSolution:
    """Weighted least squares with a weak prior, which alone counts in directions that data know less of than it does.

    The prior, of which every part may be 100 % wrong, is a body with the centre of mass in ``centre``.

    Args:
        information: Of all samples that count.
        centre: Guess of the centre of mass in ``F_i``, for instance the middle of the grasps, shape (3,) [m].
        length: Rough size of the body [m], for instance the distance of the grasps from ``centre``.
    """
    # How much the guess may be wrong, and what is guessed about the inertia, hang on mass and centre of mass: so these
    # are learned first. The first mass is too large rather than too small, as if torques were forces: a guess that is
    # too small is trusted too much, and nothing could ever correct it.
    rough = float(np.sqrt(max(information.square, 0.0) / max(information.uncompensated[0, 0], 1e-300)))
    mass, com = max(rough, _LIGHTEST), centre
    data = _SeenData.of(information, length)
    for _ in range(_GUESSES):
        guessed = mass
        solution, covariance = data.beside_guess(information, mass, com, length)
        spread = float(np.sqrt(covariance[0, 0]))
        mass, com = (float(solution[0]), solution[1:4] / solution[0]) if solution[0] > spread else (spread, centre)
        if abs(mass - guessed) < _GOOD_GUESS * mass:
            break
    offset = solution[INERTIA_SIZE:] if len(solution) > INERTIA_SIZE else None
    return InertiaSolution(solution[:INERTIA_SIZE], covariance, offset, length)


@dataclass(frozen=True, eq=False)
class _SeenData:
    """Eigenvectors of the information, ascending, in units of a prior's standard deviations for a body of 1 kg.

    Attributes:
        values: Motion in the information, with a margin for its noise, shape (u,), ascending.
        directions: What each belongs to, as columns, shape (u, u).
        matrix: Information in these directions, shape (u, u).
        score_covariance: Likewise.
    """

    values: Array
    directions: Array
    matrix: Array
    score_covariance: Array

    @staticmethod
    def of(information: InertiaInformation, length: float) -> _SeenData:
        size = information.matrix.shape[-1]
        each = (1.0, *[length] * 3, *[length**2] * 6, *[_GRAVITY] * 3, *[_GRAVITY * length] * 3)
        scale = np.array(each[:size])
        motion = (1.0 + _SIGNAL) * information.matrix - _SIGNAL * information.uncompensated
        values, vectors = np.linalg.eigh(motion * (scale[:, None] * scale))
        directions = scale[:, None] * vectors
        matrix, covariance = (
            directions.T @ each @ directions for each in (information.matrix, information.score_covariance)
        )
        return _SeenData(values, directions, matrix, covariance)

    def beside_guess(
        self, information: InertiaInformation, mass: float, com: Array, length: float
    ) -> tuple[Array, Array]:
        """What data and guess say together: all unknowns, and the covariance (10, 10) of ``theta``."""
        first = int(np.searchsorted(self.values, mass**-2, side="right"))
        unseen, seen = mass * self.directions[:, :first], mass * self.directions[:, first:]
        # In these units the guess has the identity as covariance, and as information.
        one = np.eye(seen.shape[1])
        inverse = np.linalg.inv(mass**2 * self.matrix[first:, first:] + one)
        spread = inverse @ (mass**2 * self.score_covariance[first:, first:] + one) @ inverse
        covariance = (seen @ spread @ seen.T + unseen @ unseen.T)[:INERTIA_SIZE, :INERTIA_SIZE]
        guess = np.zeros(len(seen))
        guess[0], guess[1:4], guess[4:INERTIA_SIZE] = mass, mass * com, mass * unit_point(com)
        guess[4:7] += mass * length**2 / 3.0
        error = information.vector - information.matrix @ guess
        return guess + seen @ (inverse @ (seen.T @ error)), covariance


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

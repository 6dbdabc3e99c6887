"""Tests whether rows fit, and whether another load or a faulty sensor explains wrenches that do not.

    s = sum of whitened residuals of k consecutive rows / sqrt(k),    s^T (I + k D)^-1 s ~ chi-square  without any fault

Residuals of a fit are smaller than the noise, so the test needs no allowance for the fit's own uncertainty; ``D`` is
the variance by which sensors may have drifted, in units of the noise.

A sensor of robot i with an offset ``b`` adds ``Ad(g_i) b`` to the total wrench, constant in the body frame, whereas
gravity turns in that frame. The two are compared by how much of the squared residuals each of them explains.
"""

from __future__ import annotations

from dataclasses import dataclass
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.linear_algebra import inverse as inverse_of
from coheft.estimation.moments.body import BodyModel
from coheft.estimation.moments.change import InformationMaps
from coheft.estimation.moments.evidence import ROUNDING_SHARE
from coheft.estimation.moments.unknowns import LOAD_SIZE, OFFSET

WINDOWS = (1, 2, 4, 8, 16, 32)
"""Numbers of consecutive rows that are tested: longer windows would show the approximations of rows."""


class Misfit(NamedTuple):
    """The statistic of the sum of residuals of the worst stretch of rows, and the index of their source."""

    chi_square: float
    source: int


def worst_misfit(residuals: Array, drift: Array | float = 0.0) -> Misfit | None:
    """Return the stretch that fits worst of residuals (n, s, d) in standard deviations, of n rows and s sources, None
    if there are no rows; ``drift`` is the diagonal of ``D``, shape (s, d) or (1, d).
    """
    sums = np.zeros((len(residuals) + 1, *residuals.shape[1:]))
    np.cumsum(residuals, axis=0, out=sums[1:])
    found = list[Misfit]()
    for rows in [rows for rows in WINDOWS if rows <= len(residuals)]:
        whitened = (sums[rows:] - sums[:-rows]) / np.sqrt(rows * (1.0 + rows * drift))
        squares = np.einsum("nsd,nsd->ns", whitened, whitened)
        largest = int(squares.argmax())
        found.append(Misfit(float(squares.flat[largest]), largest % squares.shape[1]))
    return max(found, key=itemgetter(0), default=None)


def excess_energy(residuals: Array, freedom: float, tolerance: float) -> float:
    """Return by how many standard deviations the sum of squared residuals exceeds its expectation for these degrees of
    freedom. The variance of the noise may exceed its nominal value by the share ``tolerance``.
    """
    expected = (1.0 + tolerance) * freedom
    return float((np.square(residuals).sum() - expected) / np.sqrt(2.0 * expected * (1.0 + tolerance)))


@dataclass(frozen=True)
class Explanations:
    """Reductions of the squared residuals of wrenches by several causes, less their degrees of freedom.

    Attributes:
        load: By another load.
        sensor: By a constant offset of the force or torque sensor that explains most, with the load known before.
        robot: Index of the robot with that sensor.
        kind: ``force`` or ``torque``.
    """

    load: float
    sensor: float
    robot: int
    kind: str


@dataclass(frozen=True, eq=False)
class KnownLoad:
    """A load that was known before.

    Attributes:
        load: Wrench offset and theta, shape (16,).
        covariance: Covariance of theta, shape (10, 10), or of both, shape (16, 16), where sensors may have offsets
            anyway; None: theta is arbitrary, and the offset known.
    """

    load: Array
    covariance: Array | None = None

    @property
    def information(self) -> tuple[Array, Array]:
        """Information on the last 10 or 16 numbers of the load, and the same without that on theta."""
        if self.covariance is None:
            return np.zeros((10, 10)), np.zeros((10, 10))
        known = inverse_of(self.covariance)
        without, offset = np.zeros_like(known), slice(0, len(known) - 10)
        without[offset, offset] = inverse_of(self.covariance[offset, offset])
        return known, without


def explanations(body: BodyModel, gram: Array, assumed: KnownLoad) -> Explanations:
    """Compare how well another load and an offset of a sensor explain wrenches, if the load ``assumed`` was known;
    ``gram`` (19, 19) is the Gram matrix of views of rows at the state of ``body``.
    """
    maps = InformationMaps.of(body, assumed.load)
    (spread,), (vector,) = maps.sums(gram[None])
    score = vector - (spread - gram[0, 0] * maps.of_noise) @ assumed.load  # the first number of a view is 1
    scale = np.maximum(spread.diagonal(), 1e-300) ** -0.5
    score, spread = scale * score, scale[:, None] * spread * scale + ROUNDING_SHARE * np.eye(LOAD_SIZE)

    # A sensor's offset is one of the wrench offset: by force, then by torque, of each robot; shape (2 N, 6, 3).
    offsets = np.concatenate([body.adjoints[:, :, :3], body.adjoints[:, :, 3:]]) / scale[OFFSET, None]
    offsets /= np.linalg.norm(offsets, axis=1, keepdims=True)
    known, without_theta = assumed.information
    of_known = scale[-len(known) :]
    by_load, _, _ = _beyond(score, spread, of_known[:, None] * without_theta * of_known)
    by_known, left, rest = _beyond(score, spread, of_known[:, None] * known * of_known)
    of_offsets, square = left @ offsets, offsets.swapaxes(1, 2) @ rest @ offsets
    by_offsets = (of_offsets * np.linalg.solve(square, of_offsets[..., None])[..., 0]).sum(axis=1)
    best = int(by_offsets.argmax())
    kind, robot = divmod(best, body.count)
    sensor = by_known + float(by_offsets[best]) - 3.0
    return Explanations(by_load - 10.0, sensor, robot, ("force", "torque")[kind])


def _beyond(score: Array, spread: Array, known: Array) -> tuple[float, Array, Array]:
    """Return what the last k numbers of the load explain, with information ``known`` (k, k) on them, and what they
    leave of score (6,) and information (6, 6) of a wrench offset.
    """
    free = slice(LOAD_SIZE - len(known), LOAD_SIZE)
    inverse = inverse_of(spread[free, free] + known)
    across = spread[OFFSET, free] @ inverse
    left = score[OFFSET] - across @ score[free]
    return float(score[free] @ inverse @ score[free]), left, spread[OFFSET, OFFSET] - across @ spread[free, OFFSET]

"""Whether rows fit what was fitted to them, and if wrenches do not, whether a load or a sensor has changed.

    s = sum of whitened residuals of k rows in a row / sqrt(k),    s . s ~ chi-square        without any fault

Residuals of a fit are smaller than noise, so nothing has to be allowed for what the fit does not know.

A sensor of robot i that reads a constant ``b`` in excess adds ``Ad(g_i) b`` to the total wrench, always the same in the
body frame; gravity turns in it. The two are compared by how much of the squared residuals each of them explains.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.linear_algebra import inverse as inverse_of
from coheft.estimation.moments.body import BodyModel
from coheft.estimation.moments.change import Weights
from coheft.estimation.moments.unknowns import LOAD_SIZE, OFFSET, THETA

WINDOWS = (1, 2, 4, 8, 16, 32)
"""Numbers of rows in a row that are tested: longer ones would show what rows approximate."""


_FAINT = 1e-10
"""Share of the information below which all is rounding."""


@dataclass(frozen=True)
class Misfit:
    """The worst stretch of rows.

    Attributes:
        first: Its first row.
        rows: Its length.
        source: Which of the sources of residuals.
        chi_square: Of the sum of its residuals.
    """

    first: int
    rows: int
    source: int
    chi_square: float


def worst_misfit(residuals: Array) -> Misfit | None:
    """The stretch of rows that fits worst, None if there are no rows.

    Args:
        residuals: In standard deviations, of n rows and s sources with d numbers each, shape (n, s, d).
    """
    worst: Misfit | None = None
    sums = np.concatenate([np.zeros((1, *residuals.shape[1:])), np.cumsum(residuals, axis=0)])
    for rows in WINDOWS:
        if rows > len(residuals):
            break
        squares = np.square(sums[rows:] - sums[:-rows]).sum(axis=2) / rows
        first, source = np.unravel_index(int(squares.argmax()), squares.shape)
        found = float(squares[first, source])
        if worst is None or found > worst.chi_square:
            worst = Misfit(int(first), rows, int(source), found)
    return worst


def excess_energy(residuals: Array, freedom: float, tolerance: float) -> float:
    """By how many standard deviations the sum of squared residuals is larger than noise makes it.

    Args:
        residuals: In standard deviations, of any shape.
        freedom: Degrees of freedom that the fit has left of them.
        tolerance: The variance of noise may be larger by this share than it was told to be.
    """
    expected = (1.0 + tolerance) * freedom
    return float((np.square(residuals).sum() - expected) / np.sqrt(2.0 * expected * (1.0 + tolerance)))


@dataclass(frozen=True)
class Explanations:
    """How much of the squared residuals of wrenches is explained, less what so many free numbers explain by chance.

    Attributes:
        load: By another load.
        sensor: By a constant excess of one force or torque sensor, that explains most beside the load that was known.
        both: By another load and a constant excess of any one sensor, more than by another load alone.
        robot: Whose sensor that is.
        kind: Which.
    """

    load: float
    sensor: float
    both: float
    robot: int
    kind: str


@dataclass(frozen=True, eq=False)
class KnownLoad:
    """A load that was known.

    Attributes:
        load: Wrench offset and theta, shape (16,).
        covariance: Of theta, shape (10, 10); None: it may be anything.
    """

    load: Array
    covariance: Array | None = None

    @property
    def information(self) -> Array:
        """On theta, shape (10, 10)."""
        return np.zeros((10, 10)) if self.covariance is None else inverse_of(self.covariance)


def explanations(body: BodyModel, gram: Array, assumed: KnownLoad) -> Explanations:
    """How well another load, or a sensor that reads something in excess, explains wrenches.

    Args:
        body: At the state.
        gram: Sum of squared views ``(motion[FORCING], total wrench)`` of rows there, shape (19, 19).
        assumed: The load.
    """
    weights = Weights.of(body, assumed.load)
    (spread,), (vector,) = weights.sums(gram[None])
    score = vector - (spread - gram[0, 0] * weights.of_noise) @ assumed.load  # the first number of a view is 1
    scale = np.maximum(spread.diagonal(), 1e-300) ** -0.5
    score, spread = scale * score, scale[:, None] * spread * scale + _FAINT * np.eye(LOAD_SIZE)
    known = scale[THETA, None] * assumed.information * scale[THETA]

    # A sensor's excess is one of the wrench offset: by force, then by torque, of each robot; shape (2 N, 6, 3).
    excess = np.concatenate([body.adjoints[:, :, :3], body.adjoints[:, :, 3:]]) / scale[OFFSET, None]
    excess /= np.linalg.norm(excess, axis=1, keepdims=True)
    by_load, beside = _beside_theta(score, spread, excess, np.zeros_like(known))
    by_known, beside_known = _beside_theta(score, spread, excess, known)
    best = int(beside_known.argmax())
    kind, robot = divmod(best, body.count)
    sensor, both = by_known + float(beside_known[best]) - 3.0, float(beside.max()) - 3.0
    return Explanations(by_load - 10.0, sensor, both, robot, ("force", "torque")[kind])


def _beside_theta(score: Array, spread: Array, excess: Array, known: Array) -> tuple[float, Array]:
    """What theta explains, and what each excess (k, 6, 3) explains beside it, with ``known`` (10, 10) of theta."""
    inverse = inverse_of(spread[THETA, THETA] + known)
    across = spread[OFFSET, THETA] @ inverse
    left = score[OFFSET] - across @ score[THETA]
    square = excess.swapaxes(1, 2) @ (spread[OFFSET, OFFSET] - across @ spread[THETA, OFFSET]) @ excess
    of_excess = left @ excess
    explained = (of_excess * np.linalg.solve(square, of_excess[..., None])[..., 0]).sum(axis=1)
    return float(score[THETA] @ inverse @ score[THETA]), explained

"""Whether rows fit what was fitted to them, and if wrenches do not, whether a load or a sensor has changed.

    s = sum of whitened residuals of k rows in a row / sqrt(k),    s . s ~ chi-square        without any fault

Residuals of a fit are smaller than noise, so nothing has to be allowed for what the fit does not know.

A sensor of robot i that reads a constant ``b`` in excess adds ``Ad(g_i) b`` to the total wrench, always the same in the
body frame; gravity turns in it. The two are compared by how much of the squared residuals each of them explains.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coheft.estimation.moments.body import BodyModel
from coheft.estimation.moments.derivatives import MotionDerivatives
from coheft.estimation.moments.likelihood import wrench_evidence
from coheft.estimation.moments.moments import WrenchMoments
from coheft.estimation.moments.unknowns import LOAD_SIZE, OFFSET, THETA
from coheft.estimation.spatial import Array

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
        sensor: By a constant excess of the one force or torque sensor that explains most.
        both: By that and another load, more than by another load alone.
        robot: Whose sensor that is.
        kind: Which.
    """

    load: float
    sensor: float
    both: float
    robot: int
    kind: str


@dataclass(frozen=True, eq=False)
class Settled:
    """A load that was known.

    Attributes:
        load: Wrench offset and theta, shape (16,).
        information: On theta, shape (10, 10).
    """

    load: Array
    information: Array


def explanations(body: BodyModel, moments: WrenchMoments, settled: Settled) -> Explanations:
    """How well another load, or a sensor that reads something in excess, explains wrenches.

    Args:
        body: At the state.
        moments: Of the wrenches.
        settled: The load that is assumed.
    """
    load = settled.load
    evidence = wrench_evidence(body, MotionDerivatives.at(body), moments, load)
    about = evidence.of(np.arange(body.unknowns.size)[body.unknowns.load])
    spread = about.information + about.noise
    scale = np.maximum(spread.diagonal(), 1e-300) ** -0.5
    score, spread = scale * about.score, scale[:, None] * spread * scale

    known = np.zeros_like(spread)
    known[THETA, THETA] = scale[THETA, None] * settled.information * scale[THETA]

    def explained(basis: Array, freedom: int, information: Array = spread) -> float:
        """By steps in the columns of ``basis`` (16, k), in units of ``scale``."""
        step: Array = np.asarray(np.linalg.lstsq(basis.T @ information @ basis, basis.T @ score, rcond=_FAINT)[0])
        return float(score @ basis @ step) - float(freedom)

    identity = np.eye(LOAD_SIZE)
    of_load, best = identity[:, THETA], Explanations(0.0, -np.inf, -np.inf, 0, "force")
    by_load = explained(of_load, 10)
    for robot, adjoint in enumerate(body.adjoints):
        for kind, part in (("force", slice(0, 3)), ("torque", slice(3, 6))):
            basis = (identity[:, OFFSET] @ adjoint[:, part]) / scale[:, None]
            basis /= np.linalg.norm(basis, axis=0)
            with_load = np.hstack([of_load, basis])
            both = explained(with_load, 13) - by_load
            if both > best.both:
                # Beside a sensor the load is still the one that was known, as well as it was.
                best = Explanations(by_load, explained(with_load, 3, spread + known), both, robot, kind)
    return best

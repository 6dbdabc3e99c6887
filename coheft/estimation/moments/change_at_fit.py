"""Tests of newest rows at a fit, with the full uncertainty of all its unknowns.

    S = e_k,    V = H_k + N_k + H_k C H_k       if the fit is to older rows only, with the covariance C
                V = H_k + N_k - H_k H^-1 H_k    if it is to the newest rows as well, with the information H

with the score ``e_k``, the information ``H_k`` and the noise ``N_k`` of the newest rows at the fit. The first is the
second test for another load (``surprise``); the other finds where, among the rows of one fit, the load or a pose has
changed (``change_within_fit``).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coheft.estimation.chi_square import chi_square_threshold
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.change import FALSE_ALARM
from coheft.estimation.moments.evidence import Evidence, all_directions, seen_directions

_LEFT = 0.05
"""A change is located by directions that older rows show as well: a fit to all rows leaves at least this share of the
information of the newest ones."""


class Shown(NamedTuple):
    """What newest rows show, around a fit, of each of several groups of g unknowns, or of one group.

    Attributes:
        score: Shape (..., g).
        information: With all unknowns of the fit, shape (..., g, u).
        alone: Of each group alone, with the regressors' noise, shape (..., g, g).
        noise: What that noise adds, shape (..., g, g).
    """

    score: Array
    information: Array
    alone: Array
    noise: Array

    @staticmethod
    def of(newest: Evidence, some: slice) -> Shown:
        """Of one group, at this slice of all unknowns."""
        noise, information = newest.noise[some, some], newest.information[some]
        return Shown(newest.score[some], information, information[:, some] + noise, noise)

    def directions(self) -> Array:
        """Return the directions of one group in which there is motion, shape (k, g)."""
        return seen_directions(self.alone, self.noise)[0]

    def along(self, tested: Array, covariance: Array, drift: Array | float = 0.0) -> tuple[Array, Array, Array]:
        """In directions (..., k, g) of a group: derivative (..., k, u), score (..., k), its covariance (..., k, k)."""
        derivative, score = tested @ self.information, (tested @ self.score[..., None])[..., 0]
        spread = tested @ (self.alone + drift) @ tested.swapaxes(-1, -2)
        return derivative, score, spread + derivative @ covariance @ derivative.swapaxes(-1, -2)


def surprise(newest: Evidence, covariance: Array, theta: slice) -> float:
    """Run the second test: return the statistic over its threshold, with the uncertainty of all unknowns.

    Args:
        newest: Evidence of the newest rows, around a fit to all others.
        covariance: Covariance of all unknowns in that fit, shape (u, u).
        theta: Slice of theta among the unknowns.
    """
    shown = Shown.of(newest, theta)
    _, score, spread = shown.along(shown.directions(), covariance)
    if len(score) == 0:
        return 0.0
    return float(score @ np.linalg.solve(spread, score)) / chi_square_threshold(len(score), FALSE_ALARM)


def change_within_fit(newest: Shown, inverse: Array, drift: Array | float = 0.0) -> Array:
    """Return the statistic of a change of each group of unknowns among the rows of a fit, chi-square with as many
    degrees of freedom as there are unknowns in a group, or fewer.

        S = e_k,    V = H_k - H_k H^-1 H_k + D    of these, with the score ``e_k`` of the newest rows at the fit

    Args:
        newest: What the rows since the change show around that fit, of groups of g unknowns.
        inverse: Inverse ``H^-1`` of the information of that fit on all unknowns, shape (u, u).
        drift: ``D``, the covariance of the score due to drifting sensors, shape (..., g, g).

    Returns:
        The statistics, shape (...); 0 if these rows do not show the unknowns.
    """
    found = all_directions(newest.alone, newest.noise)
    if found is None and newest.score.ndim > 1:  # a group is not shown in all directions
        drifts = np.broadcast_to(drift, newest.noise.shape)
        return np.array([change_within_fit(Shown(*one), inverse, by) for *one, by in zip(*newest, drifts, strict=True)])
    tested = newest.directions() if found is None else found[0]
    _, score, spread = newest.along(tested, -inverse, drift)  # the fit is to these rows as well
    shares, axes = np.linalg.eigh(spread)
    is_left = shares > _LEFT
    squares: Array = np.square((score[..., None, :] @ axes)[..., 0, :]) / np.where(is_left, shares, np.inf)
    return np.asarray(squares.sum(axis=-1))


def error_by_step(newest: Array, inverse: Array, theta: slice) -> Array:
    """Return the derivative of a fit's error by a step of theta that it does not allow for, shape (u, 10).

        x^ - x = (H^-1 H_k - E) step,    E = unit vectors of theta

    Args:
        newest: Information between all unknowns and theta, shape (u, 10), of the rows since the step that are in the
            fit.
        inverse: Inverse ``H^-1`` of the information of that fit on all unknowns, shape (u, u).
        theta: Slice of theta among the unknowns.
    """
    result: Array = inverse @ newest - np.eye(len(inverse))[:, theta]
    return result


def likeliest_step(newest: Evidence, covariance: Array, theta: slice) -> Array:
    """Return the likeliest difference (10,) of theta from that fit; arguments as for ``surprise``, but the covariance
    includes that of the difference.
    """
    shown = Shown.of(newest, theta)
    derivative, score, spread = shown.along(shown.directions(), covariance)
    step: Array = covariance[theta] @ derivative.T @ np.linalg.solve(spread, score)
    return step

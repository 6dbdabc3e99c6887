"""A quadratic log likelihood, corrected for the noise of its regressors.

    log L(step) = score . step - step . information . step / 2

Noise in the regressors adds ``noise`` to the information on average; ``information`` is without it. The covariance of
the score is the sum of both, so that of a fit is ``H^-1 (H + N) H^-1`` with ``H`` the information and ``N`` the noise.
This holds in directions in which ``H`` exceeds the uncertainty of ``N`` (``doubt``) and the information of a prior.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.linear_algebra import inverse as inverse_of
from coheft.estimation.linear_algebra import is_positive_definite
from coheft.estimation.moments.unknowns import Indices

_DOUBT, _LEAST_DOUBT = 5.0, 0.3
"""The noise is uncertain by so many of its standard deviations, and at least by this share (noise tolerances)."""
_HIDDEN = 400.0
"""Assumed variance of a hidden direction, over that at which it would just be seen: 20 times the deviation."""
_LEAST_MOTION_SHARE = 0.1
"""Directions are tested if at least this share of their information is motion, not its noise."""
_WELL = 1e-6
"""Least eigenvalue of a scaled matrix that is inverted without testing its directions."""
ROUNDING_SHARE = 1e-10
"""Share of the information below which all is rounding."""


class Solution(NamedTuple):
    """Solution of a quadratic.

    Attributes:
        inverse: Inverse of the information in the directions that are seen, shape (u, u).
        seen: Covariance of a fit in these directions.
        hidden: Assumed covariance in all other directions, in which a fit makes no step.
    """

    inverse: Array
    seen: Array
    hidden: Array


@dataclass(frozen=True, eq=False)
class Evidence:
    """The quadratic around some value of u unknowns.

    Attributes:
        score: Gradient of the log likelihood, shape (u,).
        information: Shape (u, u).
        noise: Contribution of the regressors' noise, already subtracted from it, shape (u, u).
        doubt: ``noise`` times its relative uncertainty, shape (u, u).
    """

    score: Array
    information: Array
    noise: Array
    doubt: Array

    @staticmethod
    def of_rows(score: Array, information: Array, noise: Array, count: float) -> Evidence:
        """Evidence of ``count`` rows."""
        return Evidence(score, information, noise, max(_LEAST_DOUBT, _DOUBT / math.sqrt(max(count, 1.0))) * noise)

    @staticmethod
    def prior(deviations: Array, error: Array | None = None) -> Evidence:
        """Evidence of independent Gaussians with these standard deviations (u,), of which infinite ones carry no
        information, and means that differ by ``error`` (u,) from the present value.
        """
        return Evidence.of_information(np.diag(deviations**-2.0), error)

    @staticmethod
    def of_information(information: Array, error: Array | None = None) -> Evidence:
        """Evidence of a Gaussian with information (u, u), whose mean is ``error`` (u,) from the present value."""
        nothing = np.zeros_like(information)
        score = np.zeros(len(information)) if error is None else information @ error
        return Evidence(score, information, nothing, nothing)

    def __add__(self, other: Evidence) -> Evidence:
        return Evidence(
            self.score + other.score,
            self.information + other.information,
            self.noise + other.noise,
            self.doubt + other.doubt,
        )

    def embedded(self, size: int, indices: slice | Indices) -> Evidence:
        """Return the same evidence among ``size`` unknowns, of which these are at ``indices``."""
        indices = np.arange(size)[indices]
        square, score = np.ix_(indices, indices), np.zeros(size)
        score[indices] = self.score
        information, noise, doubt = np.zeros((3, size, size))
        information[square], noise[square], doubt[square] = self.information, self.noise, self.doubt
        return Evidence(score, information, noise, doubt)

    def restricted(self, indices: Indices) -> Evidence:
        """Return the evidence on these unknowns, given the present values of all others."""
        squares = (each.take(indices, 0).take(indices, 1) for each in (self.information, self.noise, self.doubt))
        return Evidence(self.score[indices], *squares)

    def shifted(self, step: Array) -> Evidence:
        """Return the same quadratic around another value, a step (u,) away."""
        return Evidence(self.score - self.information @ step, self.information, self.noise, self.doubt)

    def marginalized(self, indices: Indices, limits: Array) -> Evidence:
        """Marginalize the unknowns at indices (k,) by a Schur complement; they keep their indices, without any
        information. For ``limits`` (k,), see ``solve``.
        """
        others = np.setdiff1d(np.arange(len(self.score)), indices)
        inverse = self.restricted(indices).solve(limits).inverse
        eliminate = np.eye(len(self.score))
        eliminate[np.ix_(others, indices)] = -self.information[np.ix_(others, indices)] @ inverse
        eliminate[indices] = 0.0
        information = eliminate @ self.information
        information[:, indices] = 0.0
        noise, doubt = (eliminate @ each @ eliminate.T for each in (self.noise, self.doubt))
        return Evidence(eliminate @ self.score, 0.5 * (information + information.T), noise, doubt)

    def with_process_noise(self, indices: slice | Indices, covariance: Array) -> Evidence:
        """Add process noise: these unknowns have changed since, by a step with this covariance (k, k).

        The step is ``root z`` with a standard normal ``z``, so the covariance may be singular.
        """
        values, vectors = np.linalg.eigh(covariance)
        root = vectors[:, values > 0.0] * np.sqrt(values[values > 0.0])
        size, changed = len(self.score), root.shape[1]
        # The old value is the new one less the step.
        before = np.hstack([np.eye(size), -np.eye(size)[:, indices] @ root])
        both = Evidence(
            before.T @ self.score, *(before.T @ each @ before for each in (self.information, self.noise, self.doubt))
        )
        step = np.arange(size, size + changed)
        both += Evidence.prior(np.ones(changed)).embedded(size + changed, step)
        return both.marginalized(step, np.full(changed, 2.0)).restricted(np.arange(size))

    def beyond_doubt(self, limits: Array) -> Evidence:
        """Return the evidence without the directions in which its information may be noise alone; ``limits`` (u,) are
        units.

        To be called before a prior is added: the doubt about noisy rows would hide what the prior shows by itself.
        """
        scale = np.outer(limits, limits)
        values, vectors = np.linalg.eigh(scale * (self.information + self.noise) + np.eye(len(limits)))
        root = np.sqrt(np.maximum(values, 1.0))[:, None]
        from_white, to_white = (vectors.T * root).T / limits[:, None], vectors.T / root * limits
        values, vectors = np.linalg.eigh(to_white @ (self.information - self.doubt) @ to_white.T)
        kept = vectors[:, values > 0.0]
        project = from_white @ kept @ kept.T @ to_white
        parts = (project @ each @ project.T for each in (self.information, self.noise, self.doubt))
        return Evidence(project @ self.score, *parts)

    def sees_all(self, limits: Array) -> bool:
        """Whether all directions are seen, see ``solve``."""
        scale = np.outer(limits, limits)
        return is_positive_definite(scale * (self.information - self.doubt) - np.eye(len(limits)))

    def solve(self, limits: Array) -> Solution:
        """Invert the information in the directions that are seen.

        A direction is seen if its information less ``doubt`` exceeds that of independent Gaussians with the standard
        deviations ``limits`` (u,).
        """
        if self.sees_all(limits):
            inverse = inverse_of(self.information)
            return Solution(inverse, inverse + inverse @ self.noise @ inverse, np.zeros_like(inverse))
        scale, one = np.outer(limits, limits), np.eye(len(limits))
        values, vectors = np.linalg.eigh(scale * (self.information + self.noise) + one)
        white = vectors.T / np.sqrt(np.maximum(values, 1.0))[:, None]
        values, vectors = np.linalg.eigh(white @ (scale * (self.information - self.doubt) - one) @ white.T)
        basis = vectors.T @ white * limits  # neither information nor noise couples these directions
        seen, hidden = basis[values > 0.0], basis[values <= 0.0]
        inverse = seen.T @ inverse_of(seen @ self.information @ seen.T) @ seen
        of_hidden = _HIDDEN * hidden.T @ inverse_of(hidden / limits**2 @ hidden.T) @ hidden
        return Solution(inverse, inverse + inverse @ self.noise @ inverse, of_hidden)


def seen_directions(matrix: Array, noise: Array) -> tuple[Array, Array]:
    """Return directions, as rows (k, u), in which there is motion, and its share of the information there (k, k).

    ``matrix``, information with noise, is the identity in these directions.
    """
    if (found := all_directions(matrix, noise)) is not None:
        return found
    scale = _scale(matrix)
    scaled, of_noise = scale[:, None] * matrix * scale, scale[:, None] * noise * scale
    values, vectors = np.linalg.eigh(scaled)
    is_real = values > ROUNDING_SHARE * values[-1]
    white = (vectors[:, is_real] / np.sqrt(values[is_real])).T
    shares, directions = np.linalg.eigh(np.eye(len(white)) - white @ of_noise @ white.T)
    is_seen = shares > _LEAST_MOTION_SHARE
    return directions[:, is_seen].T @ white * scale, np.diag(shares[is_seen])


def all_directions(matrix: Array, noise: Array) -> tuple[Array, Array] | None:
    """Return the same for matrices (..., u, u) whose rows show all directions; None if one of them does not."""
    scale = _scale(matrix)
    scaled, of_noise = (scale[..., :, None] * each * scale[..., None, :] for each in (matrix, noise))
    one = np.eye(matrix.shape[-1])
    if not is_positive_definite((1.0 - _LEAST_MOTION_SHARE) * scaled - of_noise - _WELL * one):
        return None
    white: Array = np.asarray(np.linalg.inv(np.linalg.cholesky(scaled)))
    return white * scale[..., None, :], one - white @ of_noise @ white.swapaxes(-1, -2)


def _scale(matrix: Array) -> Array:
    """Return what makes the diagonal of matrices (..., u, u) one, shape (..., u)."""
    result: Array = np.maximum(np.diagonal(matrix, axis1=-2, axis2=-1), 1e-300) ** -0.5
    return result

"""Whether some of the samples are of another load than the rest: a generalised likelihood ratio test.

Basseville and Nikiforov (1993). Samples come as packed Gram matrices (``inertia.packed_gram``), maybe with the size of
a disturbance: something that spoils wrenches beside noise, like poses that are off.
"""

from __future__ import annotations

import numpy as np

from coheft.estimation.inertia import GRAM_SIZE, InertiaInformation, InertiaModel
from coheft.estimation.spatial import Array

_TESTED = 0.2
"""Directions are tested in which at least this share of the information is motion, and not noise of motion."""


def compare_loads(model: InertiaModel, total: Array, parts: Array, coherence: float) -> tuple[Array, int]:
    """Statistic of each part against the rest, chi-square if their load is the same, and its degrees of freedom.

    If the load is one, the score of the part, ``u = vector - matrix @ estimate`` with the estimate from all, has mean
    zero and a known covariance ``C``, and the statistic is ``u^T C^-1 u``. Without noise in the regressor this equals
    ``RSS(all) - RSS(rest) - RSS(part)``; with it, unlike that, it stays true when the load is at rest for a while, and
    noise is all there is to see.

    A disturbance adds to the scores of both, ``du = (1 - gain) dpart - gain drest``. What it adds in ``n`` samples has
    a covariance ``n`` times as large as if it were new with every sample, or ``coherence`` times, if it keeps its
    direction for no longer than that.

    Args:
        model: The weights, and the covariance of the disturbance up to its size.
        total: Sums of all samples, shape (190 + riders,): packed Gram matrix, then the size of the disturbance.
        parts: Sums of some of them, shape (k, 190 + riders).
        coherence: Number of samples, or 0 if there is no disturbance; infinite if it keeps its direction all along.

    Returns:
        Statistics (k,), and the number of directions that were compared.
    """
    if len(parts) == 0:
        return np.empty(0), 0
    everything, part = model.information(total[:GRAM_SIZE]), model.information(parts[:, :GRAM_SIZE])
    # In these coordinates the score covariance of everything is the identity, and its matrix diagonal.
    basis, _, shares = signal_directions(everything.matrix, _safe_score_covariance(everything), _TESTED)
    if len(basis) == 0:
        return np.zeros(len(parts)), 0
    matrix = basis @ part.matrix @ basis.T
    gain = matrix / shares
    score = part.vector @ basis.T - gain @ (basis @ everything.vector)
    own = basis @ _safe_score_covariance(part) @ basis.T
    cross = gain @ own
    spread = own - cross - cross.swapaxes(-1, -2) + gain @ gain.swapaxes(-1, -2)
    one = np.eye(len(basis))
    rest = one - gain
    if coherence > 0.0:
        for share, sums in ((rest, parts), (gain, total - parts)):
            disturbance = basis @ _disturbance(model, sums, coherence) @ basis.T
            spread += share @ disturbance @ share.swapaxes(-1, -2)
    whitened = np.linalg.solve(spread + 1e-9 * one, score[..., None])[..., 0]
    return (score * whitened).sum(axis=1), len(basis)


def _disturbance(model: InertiaModel, sums: Array, coherence: float) -> Array:
    """Covariance of what a disturbance adds to the scores of samples (..., 190 + riders), shape (..., u, u)."""
    grams = sums[..., :GRAM_SIZE]
    share = np.minimum(1.0, coherence / np.maximum(grams[..., 0], 1.0))
    result: Array = (share * sums[..., GRAM_SIZE])[..., None, None] * model.disturbance(grams)
    return result


def signal_directions(matrix: Array, covariance: Array, least: float) -> tuple[Array, Array, Array]:
    """The directions in which information is motion and not mostly its noise.

    Args:
        matrix: Of the information, shape (u, u).
        covariance: Of its vector, shape (u, u).
        least: Share of motion from which on a direction is returned.

    Returns:
        ``basis`` (r, u), ``dual`` (r, u) and ``shares`` (r,): ``basis @ vector`` has the identity as covariance,
        ``basis @ matrix @ basis.T == diag(shares)``, and ``dual @ theta`` are the unknowns in these coordinates.
    """
    scale = np.sqrt(covariance.diagonal())
    balanced = covariance / scale[:, None] / scale + 1e-12 * np.eye(len(scale))
    root = scale[:, None] * np.linalg.cholesky(balanced)
    whitening = np.linalg.inv(root)
    shares, directions = np.linalg.eigh(whitening @ matrix @ whitening.T)
    seen = shares > least
    return directions[:, seen].T @ whitening, directions[:, seen].T @ root.T, shares[seen]


def _safe_score_covariance(information: InertiaInformation) -> Array:
    """With the regressor's noise as expected on top of what it happened to be: in a few samples that can be nil."""
    result: Array = 2.0 * information.uncompensated - information.matrix
    return result

"""Whether some of the samples are of another load than the rest: generalised likelihood ratio tests.

Basseville and Nikiforov (1993). Samples come as packed Gram matrices (``inertia.packed_gram``), maybe with the size of
a disturbance: something that spoils wrenches beside noise, like poses that are off.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coheft.estimation.inertia import GRAM_SIZE, INERTIA_SIZE, TORQUE_OFFSET, InertiaModel
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
    everything, part = _Evidence.of(model, total), _Evidence.of(model, parts)
    if coherence == 0.0:
        return _compare(everything, part)
    disturbances = [_disturbance(model, sums, coherence) for sums in (parts, total - parts)]
    return _compare(everything, part, *disturbances)


def compare_despite_offset(model: InertiaModel, before: Array, since: Array, coherence: float) -> tuple[float, int]:
    """As ``compare_loads``, where a constant torque may have come with a part: of a sensor that is off since.

    Args:
        model: The weights, of a load without offset.
        before: Sums of the rest, without the torque, shape (190 + riders,).
        since: Of the part.
        coherence: As for ``compare_loads``.

    Returns:
        The statistic, chi-square if the load is the same, and the number of directions that were compared.
    """
    with_offset = model.with_offset()
    rest, part = _Evidence.of(model, before), _Evidence.of(with_offset, since)
    torque = part.matrix[TORQUE_OFFSET, TORQUE_OFFSET]
    # What the part says of theta, whatever the torque is.
    despite = np.eye(INERTIA_SIZE, with_offset.unknowns)
    despite[:, TORQUE_OFFSET] = -np.linalg.solve(torque, part.matrix[TORQUE_OFFSET, :INERTIA_SIZE]).T
    part = part.seen_by(despite)
    everything = _Evidence(*(one + other for one, other in zip(rest, part, strict=True)))
    part = _Evidence(*(array[None] for array in part))
    if coherence == 0.0:
        statistics, seen = _compare(everything, part)
    else:
        by_part = despite @ _disturbance(with_offset, since, coherence) @ despite.T
        statistics, seen = _compare(everything, part, by_part[None], _disturbance(model, before[None], coherence))
    return float(statistics[0]), seen


class _Evidence(NamedTuple):
    """What samples say: ``matrix @ unknowns = vector``, and how far off that is by noise, a covariance."""

    matrix: Array
    vector: Array
    by_noise: Array

    @staticmethod
    def of(model: InertiaModel, sums: Array) -> _Evidence:
        """Of samples (..., 190 + riders)."""
        information = model.information(sums[..., :GRAM_SIZE])
        # With the regressor's noise as expected on top of what it happened to be: in a few samples that can be nil.
        by_noise = 2.0 * information.uncompensated - information.matrix
        return _Evidence(information.matrix, information.vector, by_noise)

    def seen_by(self, combination: Array) -> _Evidence:
        """Of combinations (k, u) of the equations, whose unknowns they are as well."""
        matrix, by_noise = (combination @ each @ combination.T for each in (self.matrix, self.by_noise))
        return _Evidence(matrix, self.vector @ combination.T, by_noise)


def _compare(everything: _Evidence, part: _Evidence, *disturbances: Array) -> tuple[Array, int]:
    """Of ``compare_loads``; disturbances (k, u, u) are what they add to the scores of parts, and of their rests."""
    # In these coordinates the score covariance of everything is the identity, and its matrix diagonal.
    basis, _, shares = signal_directions(everything.matrix, everything.by_noise, _TESTED)
    if len(basis) == 0:
        return np.zeros(len(part.matrix)), 0
    part = part.seen_by(basis)
    gain = part.matrix / shares
    score = part.vector - gain @ (basis @ everything.vector)
    cross = gain @ part.by_noise
    spread = part.by_noise - cross - cross.swapaxes(-1, -2) + gain @ gain.swapaxes(-1, -2)
    one = np.eye(len(basis))
    for share, disturbance in zip((one - gain, gain), disturbances, strict=False):
        spread += share @ (basis @ disturbance @ basis.T) @ share.swapaxes(-1, -2)
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

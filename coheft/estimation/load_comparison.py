"""Whether some of the samples are of another load than the rest: generalised likelihood ratio tests.

Basseville and Nikiforov (1993). Samples come as packed Gram matrices (``inertia.packed_gram``), maybe with the size of
a disturbance: something that spoils wrenches beside noise, like poses that are off.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from coheft.estimation.inertia import GRAM_SIZE, INERTIA_SIZE, OFFSETS, InertiaModel
from coheft.estimation.inertia_derivatives import central_derivative
from coheft.estimation.inertia_estimate import InertiaEstimate
from coheft.estimation.rigid_body import Inertia
from coheft.estimation.spatial import Array

_TESTED = 0.2
"""Directions are tested in which at least this share of the information is motion, and not noise of motion."""
_OUTWEIGHED = 5.0
"""What is known from so many times less information hardly counts."""
_SINGULAR = 1e-12
"""What is added to correlations so that they have an inverse."""
_LIGHTEST = 1e-3
"""No load is taken to have been lighter than this share of what it seems to be now."""
_HARDLY = 1e-6
"""Information, relative to the rest, that a direction is taken to have that was not seen."""


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
        model: The weights, and the disturbance of all samples.
        total: Sums of all samples, shape (190 + riders,): packed Gram matrix, then the size of what else disturbs them.
        parts: Sums of some of them, shape (k, 190 + riders).
        coherence: Number of samples, or 0 if there is no disturbance; infinite if it keeps its direction all along.

    Returns:
        Statistics (k,), and the number of directions that were compared.
    """
    if len(parts) == 0:
        return np.empty(0), 0
    everything, part = _Evidence.of(model, total), _Evidence.of(model, parts)
    # In these coordinates the score covariance of everything is the identity, and its matrix diagonal.
    basis, _, shares = signal_directions(everything.matrix, everything.by_noise, _TESTED)
    if len(basis) == 0:
        return np.zeros(len(parts)), 0
    part = part.seen_by(basis)
    one, gain = np.eye(len(basis)), part.matrix / shares
    score = part.vector - gain @ (basis @ everything.vector)
    of_part = part.by_noise
    of_rest = one - of_part
    if coherence > 0.0:
        each, all_of_them = (basis @ model.disturbance(sums[..., :GRAM_SIZE]) @ basis.T for sums in (parts, total))
        of_part = of_part + _disturbance_size(model, parts, coherence) * each
        of_rest = of_rest + _disturbance_size(model, total - parts, coherence) * (all_of_them - each)
    # (1 - gain) of_part (1 - gain)^T + gain of_rest gain^T
    kept = of_part - gain @ of_part
    spread = kept + (gain @ of_rest - kept) @ gain.swapaxes(-1, -2)
    whitened = np.linalg.solve(spread + 1e-9 * one, score[..., None])[..., 0]
    return (score * whitened).sum(axis=1), len(basis)


class KnownLoad(NamedTuple):
    """What a load is known to be.

    Attributes:
        parameters: ``theta``, shape (10,).
        covariance: Of its error, shape (10, 10); large in directions that the motion has not shown.
    """

    parameters: Array
    covariance: Array

    @staticmethod
    def of(model: InertiaModel, sums: Array, coherence: float) -> KnownLoad:
        """By samples (190 + riders,); arguments as of ``compare_loads``."""
        return KnownLoad._by(_Evidence.of(model, sums), _disturbance(model, sums, coherence))

    @staticmethod
    def despite_offset(model: InertiaModel, sums: Array, coherence: float) -> KnownLoad:
        """As ``of``, where a constant wrench may have come with the samples: of a sensor that is off."""
        evidence, disturbance = _despite_offset(model, sums[None], coherence)
        return KnownLoad._by(_Evidence(*(each[0] for each in evidence)), disturbance[0])

    @staticmethod
    def _by(seen: _Evidence, disturbance: Array) -> KnownLoad:
        ridge = _HARDLY * np.diag(seen.by_noise.diagonal())
        inverse = np.linalg.inv(seen.matrix + ridge)
        scatter = seen.by_noise + ridge + disturbance
        return KnownLoad(inverse @ seen.vector, inverse @ scatter @ inverse.T)

    def outweighs(self, other: KnownLoad) -> bool:
        """Whether so much more is known of it, in the mean of all directions, that the other one hardly counts."""
        volumes = [np.linalg.slogdet(load.covariance)[1] for load in (self, other)]
        return bool(volumes[0] + INERTIA_SIZE * np.log(_OUTWEIGHED) < volumes[1])

    def outweighs_everywhere(self, other: KnownLoad) -> bool:
        """Whether so much more is known of it in every direction."""
        scale = np.sqrt(other.covariance.diagonal())
        own, others = (load.covariance / scale[:, None] / scale for load in (self, other))
        whitening = np.linalg.inv(np.linalg.cholesky(others + _SINGULAR * np.eye(INERTIA_SIZE)))
        return bool(np.linalg.eigvalsh(whitening @ own @ whitening.T)[-1] < 1.0 / _OUTWEIGHED)


def maybe_former(estimate: InertiaEstimate, former: KnownLoad) -> InertiaEstimate:
    """An estimate of a load that may be the former one as well, so uncertain that it is right in either case."""
    now = estimate.inertia
    mass = max(float(former.parameters[0]), _LIGHTEST * now.mass)
    then = Inertia.from_barycentric([mass, *former.parameters[1:]])
    apart = then.central() - now.central()
    derivative = central_derivative(then)
    covariance = derivative @ former.covariance @ derivative.T + np.outer(apart, apart)
    return replace(estimate, covariance=estimate.covariance + covariance)


def compare_with_load(model: InertiaModel, load: KnownLoad, parts: Array, coherence: float) -> Array:
    """Statistic of each part against a load that is known, chi-square with 10 degrees of freedom if it is theirs.

    Args:
        model: The weights.
        load: It.
        parts: Sums of samples, shape (k, 190 + riders).
        coherence: As for ``compare_loads``.

    Returns:
        Shape (k,).
    """
    return _off(load, _Evidence.of(model, parts), _disturbance(model, parts, coherence))


def compare_despite_offset(model: InertiaModel, load: KnownLoad, parts: Array, coherence: float) -> Array:
    """As ``compare_with_load``, where a constant wrench may have come with each part: of a sensor that is off."""
    return _off(load, *_despite_offset(model, parts, coherence))


def _despite_offset(model: InertiaModel, parts: Array, coherence: float) -> tuple[_Evidence, Array]:
    """What parts say of ``theta``, whatever constant wrench came with them, and what a disturbance adds to that."""
    with_offset = model.with_offset()
    seen, disturbance = _Evidence.of(with_offset, parts), _disturbance(with_offset, parts, coherence)
    offset = seen.matrix[:, OFFSETS, OFFSETS]
    despite = np.zeros((len(parts), INERTIA_SIZE, with_offset.unknowns))
    despite[:, :, :INERTIA_SIZE] = np.eye(INERTIA_SIZE)
    gain = np.linalg.solve(offset, seen.matrix[:, OFFSETS, :INERTIA_SIZE])
    despite[:, :, OFFSETS] = -gain.swapaxes(-1, -2)
    return seen.seen_by(despite), despite @ disturbance @ despite.swapaxes(-1, -2)


def _off(load: KnownLoad, parts: _Evidence, disturbance: Array) -> Array:
    score = parts.vector - parts.matrix @ load.parameters
    spread = parts.by_noise + disturbance + parts.matrix @ load.covariance @ parts.matrix.swapaxes(-1, -2)
    whitened = np.linalg.solve(spread, score[..., None])[..., 0]
    result: Array = (score * whitened).sum(axis=-1)
    return result


class _Evidence(NamedTuple):
    """What samples say: ``matrix @ unknowns = vector``, and how far off that is by noise.

    Attributes:
        matrix: Shape (..., u, u).
        vector: Shape (..., u).
        samples: How many, shape (...).
        noise: What noise of a sample's motion adds to the matrix, if it is not taken away, shape (u, u) or (..., u, u).
    """

    matrix: Array
    vector: Array
    samples: Array
    noise: Array

    @staticmethod
    def of(model: InertiaModel, sums: Array) -> _Evidence:
        """Of samples (..., 190 + riders)."""
        information = model.information(sums[..., :GRAM_SIZE])
        return _Evidence(information.matrix, information.vector, information.count, model.noise)

    @property
    def by_noise(self) -> Array:
        """Covariance of ``vector - matrix @ unknowns`` at the true unknowns, shape (..., u, u)."""
        # With the regressor's noise as expected on top of what it happened to be: in a few samples that can be nil.
        return self.matrix + (2.0 * self.samples)[..., None, None] * self.noise

    def seen_by(self, combination: Array) -> _Evidence:
        """Of combinations (..., r, u) of the equations, whose unknowns they are as well."""
        back = combination.swapaxes(-1, -2)
        matrix, noise = combination @ self.matrix @ back, combination @ self.noise @ back
        return _Evidence(matrix, (combination @ self.vector[..., None])[..., 0], self.samples, noise)


def _disturbance(model: InertiaModel, sums: Array, coherence: float) -> Array:
    """Covariance of what a disturbance adds to the scores of samples (..., 190 + riders), shape (..., u, u)."""
    if coherence == 0.0:
        return np.zeros((*sums.shape[:-1], model.unknowns, model.unknowns))
    result: Array = _disturbance_size(model, sums, coherence) * model.disturbance(sums[..., :GRAM_SIZE])
    return result


def _disturbance_size(model: InertiaModel, sums: Array, coherence: float) -> Array:
    """How many times what it would be if it were new with every sample and of size one, shape (..., 1, 1)."""
    count = sums[..., 0]
    share = np.minimum(1.0, coherence / np.maximum(count, 1.0))
    size: Array = (share * (model.disturbance_size * count + sums[..., GRAM_SIZE]))[..., None, None]
    return size


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

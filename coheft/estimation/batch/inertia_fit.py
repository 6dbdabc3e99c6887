"""Inertia from motion: by least squares, and with other robots as instruments.

Accelerations from encoders are noisy. Noise in the regressor biases least squares: all moments of inertia become too
small, by the share of noise in the square of the acceleration. Other robots measure the same motion with independent
noise, so that products of **different** robots' signals have no such bias, whatever the noise is (instrumental
variables: Durbin 1954; Söderström and Stoica 1983).
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from coheft.errors import RecordingError
from coheft.estimation.batch.signals import regressor
from coheft.estimation.batch.statistics import scatter_of_sum
from coheft.estimation.geometry.body_motion import BODY_ALPHA, BODY_W
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.mass_properties import euler_regressor

_REWEIGHTINGS = 3
_FINEST = 1e-4
"""Least residual as a share of the wrench, so that weights are finite."""
_ROUNDING = 1e-12
"""Share of the largest information below which it is rounding."""
_BIAS_STEPS = 5
_STILL = 1e-6
"""Accelerations below this are rounding [rad/s², m/s²]."""


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Solution of a linear model.

    Attributes:
        solution: The unknowns, shape (u,); zero along hidden directions.
        covariance: Their covariance without hidden directions, shape (u, u).
        residual: Residuals of the model, shape (n, rows).
        hidden: Unit directions on which the data have no information, as columns, shape (u, k).
        weight: Weight of each row, shape (rows,).
        noise: The part of the covariance that is due to noise, and not to the prior, shape (u, u).
        shrinkage: How much of the difference between solution and prior mean the prior takes away, shape (u, u).
    """

    solution: Array
    covariance: Array
    residual: Array
    hidden: Array
    weight: Array
    noise: Array
    shrinkage: Array


def fit_tensor(motion: Array, wrench: Array, com: Array, rate: float) -> LinearFit:
    """Inertia at the known centre of mass: ``J alpha + w x J w = T - h x F`` (Zhang et al., eqs 18 to 33).

    Motion (n, 12), total wrench (n, 6) and centre of mass (3,) are those of the body frame; ``J`` is packed, u = 6.
    """
    matrix = euler_regressor(motion[:, BODY_W], motion[:, BODY_ALPHA])
    moment = wrench[:, 3:] - np.cross(com, wrench[:, :3])
    return instrumental_fit(matrix[None], moment, matrix[None], np.ones(3), rate)


def bias_of_tensor(motions: Array, wrench: Array, com: Array, rate: float, tensor: Array) -> tuple[Array, Array]:
    """Expected error (6,) of ``fit_tensor`` because noise of accelerations is taken for motion, and covariance (6, 6).

    The error is ``-(X^T X)^-1 Q J``, with ``J`` the true tensor and ``Q`` the part of ``X^T X`` that is noise, which
    follows from how much robots disagree. Unlike the difference from an unbiased fit, it hardly has noise of its own.
    The covariance is that about the expectation: residuals of the biased fit would count the bias as noise.

    Motions (N, n, 12) of the first robot's frame are as each robot predicts them; ``tensor`` (6,) is the solution of
    ``fit_tensor``, for the first one.
    """
    regressors = np.array([euler_regressor(motion[:, BODY_W], motion[:, BODY_ALPHA]) for motion in motions])
    own = regressors[0]
    flat, noise = own.reshape(-1, 6), (own - others(regressors)[0]).reshape(-1, 6)
    inverse, _ = _inverse_and_hidden(flat.T @ flat, np.zeros(6, dtype=np.bool_), _STILL**2 * 3 * len(own))
    # The others' mean has noise as well.
    share = (len(motions) - 1) / len(motions)
    shrinkage = share * inverse @ noise.T @ noise
    bias: Array = -shrinkage @ tensor
    for _ in range(_BIAS_STEPS):  # the true tensor is the biased one without its bias
        bias = -shrinkage @ (tensor - bias)
    residual = wrench[:, 3:] - np.cross(com, wrench[:, :3]) - own @ (tensor - bias)
    scores = np.einsum("kru,kr->ku", own, residual)
    return bias, inverse @ scatter_of_sum(scores - scores.mean(axis=0), rate, 6) @ inverse.T


def fit_parameters(motions: Array, wrench: Array, rate: float, weight: Array | None = None) -> LinearFit:
    """Fit ``theta = (m, m h, I_o)``, u = 10, to motion and gravity, each robot with the others as instruments.

    Motions (N, n, 12) of the body frame are as each robot predicts them. Without weights (6,) of the components of the
    total wrench (n, 6) these are the inverse variances of their residuals.
    """
    regressors = np.array([regressor(motion) for motion in motions])
    instruments = others(regressors)
    if weight is not None:
        return instrumental_fit(regressors, wrench, instruments, weight, rate)
    weight = np.ones(6)
    for _ in range(_REWEIGHTINGS):
        fit = instrumental_fit(regressors, wrench, instruments, weight, rate)
        weight = 1.0 / residual_variance(fit.residual, wrench)
    return fit


def residual_variance(residual: Array, output: Array) -> Array:
    """Mean square of each component of residuals (n, rows), shape (rows,); at least a small share of the output's."""
    size = float(np.mean(output**2))
    if size == 0.0:
        raise RecordingError("wrenches of all robots cancel all the time, so nothing shows the mass")
    result: Array = np.maximum(np.mean(residual**2, axis=0), _FINEST**2 * size)
    return result


def instrumental_fit(
    regressors: Array,
    output: Array,
    instruments: Array,
    weight: Array,
    rate: float,
    prior: tuple[Array, Array] | None = None,
) -> LinearFit:
    """Solve ``sum over robots and samples of Z^T W (y - X theta) = 0``; with ``Z = X``, least squares.

    Args:
        regressors: ``X`` as each robot has it, shape (N, n, rows, u).
        output: ``y``, shape (n, rows).
        instruments: ``Z`` for each of them, same shape as the regressors.
        weight: ``W``'s diagonal, shape (rows,).
        rate: Samples per second.
        prior: Prior mean of the unknowns and independent information on each of them, shape (u,) each; then ``W`` has
            to be the inverse variance, not only proportional to it.
    """
    mean, information = np.zeros((2, regressors.shape[-1])) if prior is None else prior
    weighted = instruments * weight[:, None]
    matrix = np.einsum("ikru,ikrv->uv", weighted, regressors, optimize=True) + np.diag(information)
    vector = np.einsum("ikru,kr->u", weighted, output, optimize=True) + information * mean
    still = _STILL**2 * regressors.shape[0] * len(output) * float(weight.sum())
    inverse, hidden = _inverse_and_hidden(matrix, information > 0.0, still)
    solution = inverse @ vector
    residuals = output - regressors @ solution
    scores = np.einsum("ikru,ikr->ku", weighted, residuals, optimize=True)
    scatter = scatter_of_sum(scores, rate, int(np.count_nonzero(information == 0.0)))
    noise = inverse @ scatter @ inverse.T
    shrinkage = inverse * information
    covariance = noise + shrinkage @ inverse.T
    return LinearFit(solution, covariance, residuals.mean(axis=0), hidden, weight, noise, shrinkage)


def _inverse_and_hidden(matrix: Array, is_held: npt.NDArray[np.bool_], least: float) -> tuple[Array, Array]:
    """Inverse of an information matrix (u, u) where there is any, and unit directions (u, k) where there is none.

    Products of different robots' signals may make it indefinite, but sums over all pairs of robots keep it symmetric.

    Unknowns that have a prior, where ``is_held`` (u,), are scaled individually, the others together; less information
    on these than ``least`` is rounding.
    """
    sizes = np.abs(np.diag(matrix))
    largest = max(float(sizes[~is_held].max()), least)
    balance = 1.0 / np.sqrt(np.where(is_held, sizes, largest))
    balanced = matrix * np.outer(balance, balance)
    values, vectors = np.linalg.eigh(0.5 * (balanced + balanced.T))
    shown = np.abs(values) > max(_ROUNDING * np.abs(values).max(), least / largest)
    directions = balance[:, None] * vectors
    seen, hidden = directions[:, shown], directions[:, ~shown]
    return (seen / values[shown]) @ seen.T, hidden / np.linalg.norm(hidden, axis=0)


def others(views: Array) -> Array:
    """For each of N estimates (N, ...) of the same quantity, the mean of the others."""
    result: Array = (views.sum(axis=0) - views) / (len(views) - 1)
    return result

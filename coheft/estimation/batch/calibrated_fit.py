"""Inertia and calibration errors of the robots, fitted together.

Poses determine the ratios of the robots' length scales, but not the common scale (``hand_eye``). Accelerations do,
because gravity is known. If true lengths are ``scale`` times the measured ones, the equations of motion hold for
measured lengths with gravity ``g / scale``, and

    m = m' / scale,    m h = (m h)',    I_o = scale I_o'.

Robot i measures the force ``(1 + e_i) f_i + o_i``, with the offset in the axes of its home frame. No motion can tell
a common scale of all forces, or an offset along gravity, from a heavier load.

A Gaussian prior of the same width as the bounds of the errors makes the fit linear; the result is then corrected. The
bounds matter where forces and lengths can explain the same motion: the scales of all robots, whose ratios are known
well, must be within them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear
from scipy.special import ndtr, ndtri

from coheft.estimation.batch.inertia_fit import LinearFit, instrumental_fit, others, residual_variance
from coheft.estimation.batch.payload import hidden_covariance
from coheft.estimation.batch.signals import Signals, body_motions, regressor, total_wrench
from coheft.estimation.batch.statistics import span_length
from coheft.estimation.batch.wrist_poses import UNIFORM_BOUND, Tolerances
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.regressor import INERTIA_SIZE

_STEPS = 6
_GRAVITY = INERTIA_SIZE
_FORCES = INERTIA_SIZE + 1
_LEARNED = 0.02
"""Smallest standard deviation of a calibration error, as a share of the prior's: products of errors, which are a few
percent each, are neglected."""
_SAMPLES = 2**14
_LEAST = 1e-2
"""Information that is added to all errors, as a share of the prior's, so that their likelihood is a distribution."""
_FARTHEST = 5.0
"""Standard deviations by which a recording may be off from the nearest errors within the bounds."""


@dataclass(frozen=True, eq=False)
class CalibratedFit:
    """The fit, in true lengths.

    Attributes:
        numbers: ``(theta, scale, force_scale, force_offset)``, see the properties, shape (11 + 4 N,).
        covariance: Covariance of the numbers, shape (11 + 4 N, 11 + 4 N).
        shown: By how much the estimates of the calibration errors follow the true ones, the rest being the prior's
            mean, shape (1 + 4 N, 1 + 4 N).
        noise: Covariance of what noise adds to these estimates, shape (1 + 4 N, 1 + 4 N).
        residual: Residual of the total wrench, shape (n, 6).
        weight: Weights of its components, shape (6,).
    """

    numbers: Array
    covariance: Array
    shown: Array
    noise: Array
    residual: Array
    weight: Array

    @property
    def parameters(self) -> Array:
        """``theta = (m, m h, I_o)``, shape (10,)."""
        return self.numbers[:INERTIA_SIZE]

    @property
    def scale(self) -> float:
        """True lengths over measured ones."""
        return float(self.numbers[_GRAVITY])

    @property
    def force_scale(self) -> Array:
        """Relative error of each robot's force scale, shape (N,)."""
        return self.numbers[_FORCES : _FORCES + (len(self.numbers) - _FORCES) // 4]

    @property
    def force_offset(self) -> Array:
        """Force offset of each robot in the axes of its home frame, shape (N, 3) [N]."""
        return self.numbers[_FORCES + len(self.force_scale) :].reshape(-1, 3)


def fit_calibrated(
    signals: Signals, poses: Sequence[Pose], tolerances: Tolerances, gravity: Array, start: CalibratedFit | None = None
) -> CalibratedFit:
    """Fit inertia and calibration errors, each robot's motion with the others' as instruments.

    Signals have rotations; ``poses`` of grasp frames are in the body frame and in measured lengths. ``start`` is a
    fit with nearly the same poses, from which one step is taken, with the same weights.
    """
    assert signals.rotation is not None  # derived from poses
    count = len(poses)
    motions = body_motions(signals, poses)
    upwards = np.zeros_like(motions)
    for view, rotation, pose in zip(upwards, signals.rotation, poses, strict=True):
        view[:, 6:9] = -(gravity @ rotation) @ pose.rotation.T
    moving = np.array([regressor(motion) for motion in motions])
    resting = np.array([regressor(motion) for motion in upwards])
    by_force = force_columns(signals.wrench, signals.rotation, poses)
    # Scales are relative to their mean: smaller forces and a smaller mass would always leave less noise.
    by_force[..., :count] -= by_force[..., :count].mean(axis=-1, keepdims=True)
    forces = np.broadcast_to(by_force, (count, *by_force.shape))
    output = total_wrench(signals.wrench, poses)
    information = np.concatenate([np.zeros(INERTIA_SIZE), tolerances.motion_errors(count) ** -2])
    stretch = 1.0  # relative size of gravity in measured lengths
    parameters, weight = np.zeros(INERTIA_SIZE), np.ones(6)
    if start is not None:
        stretch, parameters, weight = 1.0 / start.scale, start.parameters / _power(start.scale), start.weight
    for step in range(_STEPS if start is None else 1):
        stretched = moving + (stretch - 1.0) * resting
        columns = np.concatenate([stretched, (resting @ parameters)[..., None], forces], axis=-1)
        mean = np.zeros(columns.shape[-1])
        mean[_GRAVITY] = 1.0 - stretch
        if step == 0 and start is None:  # without parameters, the effect of a stretch is unknown
            columns[..., _GRAVITY] = 0.0
        fit = instrumental_fit(columns, output, others(columns), weight, signals.rate, (mean, information))
        parameters = fit.solution[:INERTIA_SIZE]
        stretch += float(fit.solution[_GRAVITY])
        weight = _deserved_weight(fit.residual, output, signals.rate)
    return _in_true_lengths(fit, stretch, information)


def force_columns(wrenches: Array, rotations: Array, poses: Sequence[Pose]) -> Array:
    """Derivative of the total wrench by the scale of each robot's forces, then by their offsets, shape (n, 6, 4 N).

    Wrenches (N, n, 6) are measured; rotations (N, n, 3, 3) are those of the grasp frames in the home frames.
    """
    scales, offsets = [], []
    for wrench, rotation, pose in zip(wrenches, rotations, poses, strict=True):
        adjoint = pose.adjoint()
        scales.append((wrench @ adjoint.T)[..., None])
        offsets.append(adjoint[:, :3] @ rotation.swapaxes(-1, -2))
    return np.concatenate([*scales, *offsets], axis=-1)


def _deserved_weight(residual: Array, output: Array, rate: float) -> Array:
    """Weights (6,) of residuals (n, 6) that are correlated in time, by their effective number of samples."""
    variance = residual_variance(residual - residual.mean(axis=0), output)
    length = span_length(len(residual), rate)
    blocks = residual[: len(residual) // length * length].reshape(-1, length, residual.shape[1])
    repeats = np.maximum(length * blocks.mean(axis=1).var(axis=0) / variance, 1.0)
    result: Array = 1.0 / (variance * repeats)
    return result


def _power(scale: float) -> Array:
    """Factors (10,) from ``(m', (m h)', I_o')`` in measured lengths to ``theta`` in true ones."""
    return np.repeat([1.0 / scale, 1.0, scale], [1, 3, 6])


def _in_true_lengths(fit: LinearFit, stretch: float, prior: Array) -> CalibratedFit:
    """Convert a fit to true lengths; ``prior`` is the prior information on its unknowns, shape (11 + 4 N,)."""
    scale, count = 1.0 / stretch, (len(prior) - _FORCES) // 4
    least = np.zeros(len(prior))
    least[INERTIA_SIZE:] = _LEARNED**2 / prior[INERTIA_SIZE:]
    covariance = fit.covariance + hidden_covariance(fit.hidden, float(fit.solution[0])) + np.diag(least)
    power = _power(scale)
    parameters = power * fit.solution[:INERTIA_SIZE]
    derivative = np.eye(len(fit.solution))
    derivative[:INERTIA_SIZE, :INERTIA_SIZE] = np.diag(power)
    # By the stretch, the inverse of the scale.
    derivative[0, _GRAVITY] = fit.solution[0]
    derivative[4:10, _GRAVITY] = -(scale**2) * fit.solution[4:10]
    derivative[_GRAVITY, _GRAVITY] = -(scale**2)
    # The common scale of forces, which the model leaves out, scales the inertia.
    derivative[:INERTIA_SIZE, _FORCES : _FORCES + count] = -parameters[:, None] / count
    of_errors = np.diag(derivative)[_GRAVITY:]
    shown = np.eye(len(of_errors)) - fit.shrinkage[_GRAVITY:, _GRAVITY:]
    return CalibratedFit(
        numbers=np.concatenate([parameters, [scale], fit.solution[_FORCES:]]),
        covariance=derivative @ covariance @ derivative.T,
        shown=shown * np.divide.outer(of_errors, of_errors),
        noise=(fit.noise + np.diag(least))[_GRAVITY:, _GRAVITY:] * np.outer(of_errors, of_errors),
        residual=fit.residual,
        weight=fit.weight,
    )


def cut_to_bounds(fit: CalibratedFit, tolerances: Tolerances, position_scales: Array) -> CalibratedFit | None:
    """Mean and covariance with uniform errors within their bounds; None if the errors cannot be within.

    The inertia follows by its correlation with the errors.

    ``fit`` has a Gaussian prior; ``position_scales`` (N,) are those of the robots without the common scale.
    """
    count = len(position_scales)
    mean, errors = fit.numbers[INERTIA_SIZE:], fit.covariance[INERTIA_SIZE:, INERTIA_SIZE:]
    spread = tolerances.motion_errors(count)
    expected = np.zeros(len(mean))
    expected[0] = 1.0
    # What the recording alone says, in units of the prior's standard deviations.
    whitening = np.linalg.inv(np.linalg.cholesky(fit.noise / np.outer(spread, spread)))
    design, found = whitening @ (fit.shown / spread[:, None] * spread), whitening @ ((mean - expected) / spread)
    information = design.T @ design + _LEAST * np.eye(len(mean))
    covariance = np.linalg.inv(information).astype(np.float64)
    told = covariance @ design.T @ found
    widest = UNIFORM_BOUND * np.sqrt(count) * spread[0]
    lower, upper = np.full((2, len(mean)), UNIFORM_BOUND) * [[-1.0], [1.0]]
    lower[0] = ((1.0 + position_scales.max()) / (1.0 + widest) - 1.0) / spread[0]
    upper[0] = ((1.0 + position_scales.min()) / (1.0 - widest) - 1.0) / spread[0]
    if lower[0] >= upper[0]:
        return None
    root = np.linalg.cholesky(information).T
    if 2.0 * lsq_linear(root, root @ told, (lower, upper)).cost > _FARTHEST**2:
        return None
    samples, weight = _within(told, covariance, lower, upper)
    samples = expected + samples * spread
    cut = np.average(samples, axis=0, weights=weight)
    gain = np.linalg.solve(errors, fit.covariance[INERTIA_SIZE:]).T
    change = np.cov(samples, rowvar=False, aweights=weight) - errors
    return replace(fit, numbers=fit.numbers + gain @ (cut - mean), covariance=fit.covariance + gain @ change @ gain.T)


def _within(mean: Array, covariance: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Samples (s, u) of a normal distribution within bounds (u,), and their weights (s,).

    Each number is drawn within its bounds given those before; its probability to be there is a factor of the weight
    (Geweke 1991; Genz 1992). A normal distribution would hardly ever have all of many numbers within.
    """
    root = np.linalg.cholesky(covariance)
    uniform = np.random.default_rng(0).random((_SAMPLES, len(mean)))
    normal, log_weight = np.zeros_like(uniform), np.zeros(_SAMPLES)
    for k, own in enumerate(root):
        given = mean[k] + normal[:, :k] @ own[:k]
        low, high = (lower[k] - given) / own[k], (upper[k] - given) / own[k]
        # Probabilities are exact in the lower tail only.
        sign = np.where(low > 0.0, -1.0, 1.0)
        low, high = np.minimum(sign * low, sign * high), np.maximum(sign * low, sign * high)
        first, last = ndtr(low), ndtr(high)
        share = np.maximum(last - first, np.finfo(float).tiny)
        normal[:, k] = sign * np.clip(ndtri(first + uniform[:, k] * share), low, high)
        log_weight += np.log(share)
    return mean + normal @ root.T, np.exp(log_weight - log_weight.max())

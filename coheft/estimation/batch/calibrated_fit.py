"""Inertia from robots whose calibration may be off: what is wrong with it is fitted along.

Poses alone tell the robots' lengths apart, not which of them is right (``hand_eye``). The motion does: it is known what
gravity is, so accelerations that look too large beside it were measured with too long a ruler. With all lengths true
``scale`` times what was measured, Newton and Euler hold for measured lengths with gravity ``g / scale``, and

    m = m' / scale,    m h = (m h)',    I_o = scale I_o'.

Forces are told by robot i as ``(1 + e_i) f_i + o_i``, with the offset in the axes of its home frame. What all of them
have too much, no motion can tell from a heavier load; nor can it tell an offset that lifts from weight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coheft.estimation.batch.body import body_motions, regressor, total_wrench
from coheft.estimation.batch.calibration import Tolerances
from coheft.estimation.batch.inertia_fit import LinearFit, Prior, instrumental_fit, others, residual_variance
from coheft.estimation.batch.payload import hidden_covariance
from coheft.estimation.batch.signals import Signals
from coheft.estimation.batch.statistics import span_length
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.regressor import INERTIA_SIZE

_STEPS = 6
_GRAVITY = INERTIA_SIZE
_FORCES = INERTIA_SIZE + 1
_LEARNED = 1e-3
"""No calibration error is known better than to this share of what it was, whatever exact numbers say."""


@dataclass(frozen=True, eq=False)
class CalibratedFit:
    """The fit, in true lengths.

    Attributes:
        numbers: ``(theta, scale, force_scale, force_offset)``, see below, shape (11 + 4 N,).
        covariance: Of the numbers, shape (11 + 4 N, 11 + 4 N).
        residual: Of the total wrench, shape (n, 6).
        weight: Of the six components of its residual, shape (6,).
    """

    numbers: Array
    covariance: Array
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
        """Of each robot, shape (N,)."""
        return self.numbers[_FORCES : _FORCES + (len(self.numbers) - _FORCES) // 4]

    @property
    def force_offset(self) -> Array:
        """Of each robot, in its home frame's axes, shape (N, 3) [N]."""
        return self.numbers[_FORCES + len(self.force_scale) :].reshape(-1, 3)


def fit_calibrated(
    signals: Signals, poses: Sequence[Pose], tolerances: Tolerances, gravity: Array, start: CalibratedFit | None = None
) -> CalibratedFit:
    """Fit inertia and calibration, every robot's motion with all others' as instruments.

    Args:
        signals: With rotations and wrenches.
        poses: Of the grasp frames in the body frame, in measured lengths.
        tolerances: How well the robots are calibrated.
        gravity: In the home frames, shape (3,) [m/s²].
        start: A fit with nearly the same poses: only one step is taken from there, with its weights.

    Raises:
        ValueError: Signals lack wrenches or rotations, there is one robot only, or all wrenches are zero.
    """
    if signals.wrench is None or signals.rotation is None:
        raise ValueError("expected signals with wrenches and rotations")
    count = len(poses)
    motions = body_motions(signals, poses)
    upwards = np.zeros_like(motions)
    for view, rotation, pose in zip(upwards, signals.rotation, poses, strict=True):
        view[:, 6:9] = -(gravity @ rotation) @ pose.rotation.T
    moving = np.array([regressor(motion) for motion in motions])
    resting = np.array([regressor(motion) for motion in upwards])
    forces = np.broadcast_to(
        _force_columns(signals.wrench, signals.rotation, poses), (count, *moving.shape[1:3], 4 * count)
    )
    output = total_wrench(signals.wrench, poses)
    information = np.concatenate([np.zeros(INERTIA_SIZE), tolerances.motion_errors(count) ** -2])
    stretch = 1.0  # gravity's size in measured lengths, relative
    parameters, weight = np.zeros(INERTIA_SIZE), np.ones(6)
    if start is not None:
        stretch, parameters, weight = 1.0 / start.scale, start.parameters / _power(start.scale), start.weight
    for step in range(_STEPS if start is None else 1):
        stretched = moving + (stretch - 1.0) * resting
        columns = np.concatenate([stretched, (resting @ parameters)[..., None], forces], axis=-1)
        mean = np.zeros(columns.shape[-1])
        mean[_GRAVITY] = 1.0 - stretch
        if step == 0 and start is None:  # the parameters are not known yet, and so not what a stretch would do
            columns[..., _GRAVITY] = 0.0
        fit = instrumental_fit(columns, output, others(columns), weight, signals.rate, Prior(mean, information))
        parameters = fit.solution[:INERTIA_SIZE]
        stretch += float(fit.solution[_GRAVITY])
        weight = _deserved_weight(fit.residual, output, signals.rate)
    return _in_true_lengths(fit, stretch, information)


def _force_columns(wrenches: Array, rotations: Array, poses: Sequence[Pose]) -> Array:
    """How scales and offsets of forces add to the total wrench, shape (n, 6, 4 N): all scales first.

    Scales count from their mean: all forces less, and the mass as well, would always leave less noise to explain.
    """
    scales, offsets = [], []
    for wrench, rotation, pose in zip(wrenches, rotations, poses, strict=True):
        adjoint = pose.adjoint()
        scales.append(wrench @ adjoint.T)
        offsets.append(adjoint[:, :3] @ rotation.swapaxes(-1, -2))
    contrasts = np.stack(scales - np.mean(scales, axis=0), axis=-1)
    return np.concatenate([contrasts, *offsets], axis=-1)


def _deserved_weight(residual: Array, output: Array, rate: float) -> Array:
    """Weights (6,) of samples that are correlated in time: as many samples as are independent count."""
    variance = residual_variance(residual - residual.mean(axis=0), output)
    length = span_length(len(residual), rate)
    blocks = residual[: len(residual) // length * length].reshape(-1, length, residual.shape[1])
    # A mean of independent samples has a variance smaller by their number.
    repeats = np.maximum(length * blocks.mean(axis=1).var(axis=0) / variance, 1.0)
    result: Array = 1.0 / (variance * repeats)
    return result


def _power(scale: float) -> Array:
    """What turns ``(m', (m h)', I_o')`` in measured lengths into ``theta`` in true ones, shape (10,)."""
    return np.repeat([1.0 / scale, 1.0, scale], [1, 3, 6])


def _in_true_lengths(fit: LinearFit, stretch: float, prior: Array) -> CalibratedFit:
    """In true lengths, of a fit in measured ones; ``prior`` is the information on its unknowns before the data."""
    scale, count = 1.0 / stretch, (len(prior) - _FORCES) // 4
    least = np.zeros(len(prior))
    least[INERTIA_SIZE:] = _LEARNED**2 / prior[INERTIA_SIZE:]
    covariance = fit.covariance + hidden_covariance(fit.hidden, float(fit.solution[0])) + np.diag(least)
    power = _power(scale)
    parameters = power * fit.solution[:INERTIA_SIZE]
    derivative = np.eye(len(fit.solution))
    derivative[:INERTIA_SIZE, :INERTIA_SIZE] = np.diag(power)
    # By the stretch, of which the scale is the inverse.
    derivative[0, _GRAVITY] = fit.solution[0]
    derivative[4:10, _GRAVITY] = -(scale**2) * fit.solution[4:10]
    derivative[_GRAVITY, _GRAVITY] = -(scale**2)
    # What all forces have too much in common was left out of the model; it would have been taken for inertia.
    derivative[:INERTIA_SIZE, _FORCES : _FORCES + count] = -parameters[:, None] / count
    return CalibratedFit(
        numbers=np.concatenate([parameters, [scale], fit.solution[_FORCES:]]),
        covariance=derivative @ covariance @ derivative.T,
        residual=fit.residual,
        weight=fit.weight,
    )

"""Whether what the team has measured lately can be true: one rigid body, and sensors with the noise that they claim.

A sensor that has gone wrong, a clock that runs off, or a neighbour that does not tell the truth spoils the sums of the
whole team, and sums do not say whose fault it is. But every robot can hold its own sensors against the motion that the
sums say the body has, and they can tell each other how well that fits.
"""

from __future__ import annotations

import math

import numpy as np

from coheft.estimation.measurement import GYRO, KINEMATICS, SensorNoise, kinematic_weights
from coheft.estimation.registration import (
    ACCELERATION_ROWS,
    ALPHA,
    FEATURES,
    TWIST_ROWS,
    RegistrationMoments,
    half_squares,
    residual_derivative,
    residual_operator,
    score_and_information,
)
from coheft.estimation.spatial import Array, Pose

MISFIT = 1.0
"""From this on a robot's measurements contradict the team's motion."""
_MEMORY = 0.3
"""Time that is looked back on [s]."""
_SLACK = 0.25
"""Share by which squared residuals may be larger than noise explains, always."""
_SIGMAS = 8.0
"""Standard deviations by which they may be larger by chance."""
_MEAN_LIMIT = 80.0
"""Limit of the chi-square of the accelerometers' mean residual, three degrees of freedom: 1e-17 by chance."""
_JUMP_LIMIT = 50.0
"""Limit of the chi-square of how far gyro and velocity are from their mean residual of late, six degrees of freedom:
5e-9 by chance. Accelerations are left out: when a load drops, they change faster than they are measured."""
_CLOCK = 5e-4
"""So far a robot's clock may be off, always [s]."""
_STILL = 1e-6
"""Sum of squared angular accelerations below which nothing turns [rad²/s⁴]."""
_OTHERS = 3.0
"""The body's motion is as far off as all robots' poses make it: as if the own pose's covariance were so many times
itself."""


class Watch:
    """One robot's own sensors against the motion of the body.

    Args:
        noise: Of its sensors.
        blocks_per_second: Blocks per second.
    """

    def __init__(self, noise: SensorNoise, blocks_per_second: float) -> None:
        self._noise = noise
        self._deviations = noise.per_column()[KINEMATICS]
        # Moments of the newest blocks, and whether each was like those before it.
        self._grams = np.zeros((max(2, round(_MEMORY * blocks_per_second)), FEATURES, FEATURES))
        self._are_like = np.zeros(len(self._grams), dtype=np.bool_)
        self._blocks = 0

    def add(self, moments: RegistrationMoments, pose: Pose, variances: Array) -> bool:
        """Take in the moments of a block; returns whether it is like those of late.

        A sensor that is off for a moment does harm, but not for long enough to contradict anything.

        Args:
            moments: Of the block.
            pose: Own pose in the body frame.
            variances: Of its perturbation, shape (6,).
        """
        is_like = self._blocks == 0 or self._jump(moments, pose, variances) < _JUMP_LIMIT
        newest = self._blocks % len(self._grams)
        self._grams[newest], self._are_like[newest] = moments.gram, is_like
        self._blocks += 1
        return is_like

    def clear(self) -> None:
        """Look back no farther than now."""
        if self._blocks:
            self._grams[:], self._are_like[:], self._blocks = 0.0, False, 0

    def map(self, feature_map: Array) -> None:
        """As if every sample's features had been ``feature_map`` (28, 28) times what they were."""
        self._grams = feature_map @ self._grams @ feature_map.T

    def misfit(self, pose: Pose, variances: Array) -> float:
        """How badly the own sensors fit lately; ``MISFIT`` is the limit. A result below it is an upper bound.

        Args:
            pose: Own pose in the body frame.
            variances: Of its perturbation, shape (6,).
        """
        if self._blocks == 0:
            return 0.0
        recent = RegistrationMoments(self._grams.sum(axis=0))
        most = self._misfit(recent, pose, None)  # errors of the pose only explain more
        return most if most <= MISFIT else self._misfit(recent, pose, variances)

    def _misfit(self, recent: RegistrationMoments, pose: Pose, variances: Array | None) -> float:
        """The same of the moments of all that is looked back on; ``variances`` None: as if the pose were exact."""
        by_noise, by_poses = 9.0 * recent.count, 0.0
        if variances is None:
            cost = half_squares(recent, pose, self._noise)
        else:
            _, information, cost = score_and_information(recent, pose, self._noise)
            by_poses = _OTHERS * float(information.diagonal() @ variances)
        limit = (1.0 + _SLACK) * (by_noise + by_poses) + _SIGMAS * math.sqrt(2.0 * by_noise)
        by_mean = self._mean_statistic(recent, pose, variances) / _MEAN_LIMIT
        return max(2.0 * cost / limit, by_mean, self._clock_misfit(recent, pose))

    def _mean_statistic(self, recent: RegistrationMoments, pose: Pose, variances: Array | None) -> float:
        """Chi-square of the accelerometer's mean residual; constant offsets of other sensors do no harm."""
        means = recent.gram[0] / recent.count
        return self._statistic(means, 1.0 / recent.count, ACCELERATION_ROWS, pose, variances)

    def _jump(self, block: RegistrationMoments, pose: Pose, variances: Array) -> float:
        """Chi-square of how far a block's gyro and velocity are from those of late; constant offsets do no harm."""
        sums = self._grams[:, 0]
        usual = self._are_like @ sums if self._are_like.any() else sums.sum(axis=0)
        means = block.gram[0] / block.count - usual / usual[0]
        share = 1.0 / block.count + 1.0 / usual[0]
        most = self._statistic(means, share, TWIST_ROWS, pose, None)  # errors of the pose only explain more
        return most if most < _JUMP_LIMIT else self._statistic(means, share, TWIST_ROWS, pose, variances)

    def _statistic(self, means: Array, share: float, rows: slice, pose: Pose, variances: Array | None) -> float:
        """Chi-square of the residuals at mean features (28,), with this share of a sample's variance.

        Args:
            means: Them.
            share: Of the variance of a sample's noise.
            rows: Of the residuals.
            pose: Own pose in the body frame.
            variances: Of its perturbation, shape (6,); None: it is exact.
        """
        residual = residual_operator(pose)[rows] @ means
        if variances is None:
            whitened = residual / self._deviations[rows]
            return float(whitened @ whitened) / share
        derivative = residual_derivative(pose)[:, rows] @ means
        spread = (derivative.T * (_OTHERS * variances)) @ derivative
        spread += np.diag(share * self._deviations[rows] ** 2)
        return float(residual @ np.linalg.solve(spread, residual))

    def _clock_misfit(self, recent: RegistrationMoments, pose: Pose) -> float:
        """How far the own clock is off: then the gyro's residuals go with the angular acceleration."""
        gram = recent.centred()
        along = residual_operator(pose)[GYRO] @ gram[:, ALPHA] * pose.rotation.T
        strength = max(float(np.trace(gram[ALPHA, ALPHA])), _STILL)
        limit = _SIGMAS * self._noise.gyro / math.sqrt(strength) + _CLOCK
        return float(abs(along.sum()) / strength / limit)


def block_misfit(moments: RegistrationMoments, pose: Pose, noise: SensorNoise) -> float:
    """Mean square of one block's residuals in units of the noise, offsets and means left out."""
    operator, gram = residual_operator(pose)[TWIST_ROWS], moments.centred()
    weights = kinematic_weights(noise)[TWIST_ROWS, None]
    return float(np.vdot(weights * (operator @ gram), operator) / (6.0 * max(moments.count, 1.0)))

"""Recursive least squares for the relative pose of two grasp frames, from their twists (Fan et al., section VI-C)."""

import numpy as np

from coheft.estimation.fan2017.dual_quaternion import (
    dual_from_pose,
    dual_tangent,
    pair_operator,
    pose_from_dual,
    right_multiplication,
    solve_rotation,
    solve_translation,
)
from coheft.estimation.fan2017.forgetting import age_weights
from coheft.estimation.geometry.observability import doubt_of
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.geometry.uncertain_pose import UncertainPose
from coheft.estimation.linear_algebra import inverse, positive_part
from coheft.estimation.measurement import SensorNoise

_PRIOR_STD = np.repeat([3.0, 10.0], 3)
"""What is known beforehand: next to nothing. Rotation [rad], translation [m]."""

_GROWTH = 0.02
"""Share of new samples that is worth another solution: they make deviations 1 % smaller."""

_UNITS = np.eye(12).reshape(12, 4, 3)
_OPERATORS = np.concatenate(
    [pair_operator(_UNITS[:, 0], _UNITS[:, 2]), pair_operator(_UNITS[:, 1], _UNITS[:, 3])], axis=2
)
"""``[H(w_i, w_j), H(v_i, v_j)]`` of each unit vector of ``z = (w_i, v_i, w_j, v_j)``, shape (12, 4, 8): linear in z."""
_GYROS = np.diag(np.repeat([1.0, 0.0, 1.0, 0.0], 3))


def _moment_map(weight: Array) -> Array:
    """Matrix (32, 144) that takes ``sum z z^T`` (12, 12) to ``sum H(w)^T W [H(w), H(v)]`` (4, 8)."""
    left, right = _OPERATORS[:, :, :4].transpose(2, 0, 1).reshape(48, 4), (weight @ _OPERATORS).transpose(1, 0, 2)
    products: Array = (left @ right.reshape(4, 96)).reshape(4, 12, 12, 8)
    return products.transpose(0, 3, 1, 2).reshape(32, 144)


def _moment(moment_map: Array, moment: Array) -> Array:
    """``sum H(w)^T W [H(w), H(v)]`` (4, 8) of samples with the second moment ``sum z z^T`` (12, 12)."""
    return (moment_map @ moment.ravel()).reshape(4, 8)


_UNWEIGHTED = _moment_map(np.eye(4))


class PoseRls:
    """Dual-quaternion filter for ``pose_j_in_i``. No initial guess, no normalisation, no local minimum.

    Args:
        noise: Of the sensors of both robots.
        forgetting: Factor per sample by which older samples count less; 1 forgets nothing.
        solve_every: Updates per solution at least: the estimate, and the weights that depend on it, are as old. Later
            it is as many as bring ``_GROWTH`` more samples.

    Attributes:
        estimate: The pose at the last solution, with its covariance; identity and next to no knowledge at first.
    """

    def __init__(self, noise: SensorNoise, forgetting: float = 1.0, solve_every: int = 1) -> None:
        self._solve_every = solve_every
        self._updates, self._samples = 0, 0.0  # since the last solution
        self._gyro_variance = noise.gyro**2
        self._velocity_variance = noise.velocity**2
        self._forgetting = forgetting
        self._rotation_moment = np.zeros((4, 4))  # H(w)^T W H(w), weighted for the rotation's equation
        self._translation_moment = np.zeros((4, 8))  # H(w)^T W [H(w), H(v)], for the translation's equation
        self._noise_share = np.zeros((4, 4))  # what unit noise of the gyros adds to the latter on average
        self._count = 0.0
        self._set(*dual_from_pose(Pose.identity()), np.diag(_PRIOR_STD**2))

    def update(self, twist_i: Array, twist_j: Array) -> None:
        """Take in simultaneous twists ``(w, v)`` of both frames, shape (B, 6) each.

        The same as B updates with one sample each, except that the weight is that of the last solution.
        """
        z = np.hstack([twist_i, twist_j])
        weights, decay = age_weights(self._forgetting, len(z)), self._forgetting ** len(z)
        moment, count = (weights * z.T) @ z, float(weights.sum())

        # cov(H(w) q_r) = 2 sigma_w^2 (I - q_r q_r^T), and the residual has no part along q_r: a scalar weight.
        of_rotation = 0.5 / self._gyro_variance * _moment(_UNWEIGHTED, moment)[:, :4]
        self._rotation_moment = decay * self._rotation_moment + of_rotation
        self._translation_moment = decay * self._translation_moment + _moment(self._weighted, moment)
        self._noise_share = decay * self._noise_share + count * self._noise_share_of_sample
        self._count = decay * self._count + count
        self._updates, self._samples = self._updates + 1, self._samples + len(z)
        if self._updates >= self._solve_every and self._samples >= _GROWTH * self._count:
            self._updates, self._samples = 0, 0.0
            self._solve()

    def _translation_noise(self) -> Array:
        """Covariance (4, 4) of ``H(v_i, v_j) q_r + H(w_i, w_j) q_d`` at the current estimate (Fan et al., Prop. 2).

        With isotropic noise, each quaternion ``b`` contributes ``2 sigma^2 (|b|^2 I - b b^T)``, and its own
        uncertainty the second-order term ``2 sigma^2 tr(cov b) I``.
        """
        noise = np.zeros((4, 4))
        for variance, b, spread_b in (
            (self._velocity_variance, self._q_r, self._spread[:4].sum()),
            (self._gyro_variance, self._q_d, self._spread[4:].sum()),
        ):
            noise += 2.0 * variance * ((b @ b + spread_b) * np.eye(4) - np.outer(b, b))
        # Along q_r the noise vanishes with q_d; while q_d is not known, the equation must not be trusted that far.
        return noise + 0.1 * self._velocity_variance * np.eye(4)

    def _solve(self) -> None:
        q_r = solve_rotation(self._rotation_moment)
        noise_ww = self._gyro_variance * self._noise_share
        # Noise in the regressor would shrink the translation; take its share out, as far as signal remains.
        ww, wv = self._translation_moment[:, :4], self._translation_moment[:, 4:]
        across = right_multiplication(q_r)[:, 1:]  # q_d is orthogonal to q_r
        ratios = np.linalg.eigvals(np.linalg.solve(across.T @ noise_ww @ across, across.T @ ww @ across))
        smallest = float(ratios.real.min())
        ww = ww - min(1.0, 0.5 * smallest) * noise_ww
        q_d = solve_translation(q_r, ww, wv)
        self._set(q_r, q_d, self._covariance_of_steps(dual_tangent(q_r, q_d), ww, wv))

    def _covariance_of_steps(self, derivative: Array, ww: Array, wv: Array) -> Array:
        """Covariance (6, 6): first the rotation from its own equation, then the translation that goes with it."""
        prior = _PRIOR_STD**-2.0
        # H(w) holds noise of both gyros: 6 sigma_w^2 per sample on average, weighted with 1 / (2 sigma_w^2).
        noise = 3.0 * self._count * np.eye(4)
        surely_motion = self._rotation_moment - noise - doubt_of(noise, self._count)
        rotation_information = positive_part(derivative[:4, :3].T @ surely_motion @ derivative[:4, :3])
        rotation_covariance = np.linalg.inv(rotation_information + prior[0] * np.eye(3))
        by_theta, by_translation = derivative[:, :3], derivative[4:, 3:]
        noise = self._gyro_variance * self._noise_share
        surely_motion = self._translation_moment[:, :4] - noise - doubt_of(noise, self._count)
        translation_information = positive_part(by_translation.T @ surely_motion @ by_translation)
        translation_covariance = np.linalg.inv(translation_information + prior[3] * np.eye(3))
        follow = -translation_covariance @ by_translation.T @ (ww @ by_theta[4:] + wv @ by_theta[:4])
        coupling = follow @ rotation_covariance
        return np.block([[rotation_covariance, coupling.T], [coupling, translation_covariance + coupling @ follow.T]])

    def _set(self, q_r: Array, q_d: Array, covariance: Array) -> None:
        self._q_r, self._q_d = q_r, q_d
        self.estimate = UncertainPose(pose_from_dual(q_r, q_d), covariance)
        derivative = dual_tangent(q_r, q_d)
        self._spread = np.diag(derivative @ covariance @ derivative.T)
        self._weighted = _moment_map(inverse(self._translation_noise()))
        self._noise_share_of_sample = _moment(self._weighted, _GYROS)[:, :4]

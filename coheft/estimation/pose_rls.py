"""Recursive least squares for the relative pose of two grasp frames, from their twists (Fan et al., section VI-C)."""

from __future__ import annotations

import numpy as np

from coheft.estimation.dual_quaternion import (
    dual_from_pose,
    dual_tangent,
    left_multiplication,
    pair_operator,
    pose_from_dual,
    right_multiplication,
    solve_rotation,
    solve_translation,
)
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.uncertain_pose import UncertainPose

_PRIOR_STD = np.repeat([3.0, 10.0], 3)
"""What is known beforehand: next to nothing. Rotation [rad], translation [m]."""


_LEFT_UNITS = left_multiplication(np.eye(4)[1:])
_RIGHT_UNITS = right_multiplication(np.eye(4)[1:])


class PoseRls:
    """Dual-quaternion filter for ``pose_j_in_i``. No initial guess, no normalisation, no local minimum.

    Args:
        noise: Of the sensors of both robots.
        forgetting: Factor per sample by which older samples count less; 1 forgets nothing.
    """

    def __init__(self, noise: SensorNoise, forgetting: float = 1.0) -> None:
        self._gyro_variance = noise.gyro**2
        self._velocity_variance = noise.velocity**2
        self._forgetting = forgetting
        self._rotation_moment = np.zeros((4, 4))  # H(w)^T W H(w), weighted for the rotation's equation
        self._translation_moment = np.zeros((8, 8))  # of [H(w), H(v)], weighted for the translation's equation
        self._noise_share = np.zeros((4, 4))  # what unit noise in a regressor adds to the latter on average
        self._set(*dual_from_pose(Pose.identity()), np.diag(_PRIOR_STD**2))

    @property
    def estimate(self) -> UncertainPose:
        """The pose so far, with its covariance; identity and next to no knowledge at first."""
        return UncertainPose(pose_from_dual(self._q_r, self._q_d), self._covariance)

    def update(self, twist_i: Array, twist_j: Array) -> None:
        """Take in simultaneous twists ``(w, v)`` of both frames, shape (B, 6) each.

        The same as B updates with one sample each, except that the weight is evaluated once per call.
        """
        h_w = pair_operator(twist_i[:, :3], twist_j[:, :3])
        h = np.concatenate([h_w, pair_operator(twist_i[:, 3:], twist_j[:, 3:])], axis=2)
        age_weights = self._forgetting ** np.arange(len(h) - 1, -1, -1.0)
        decay = self._forgetting ** len(h)

        # cov(H(w) q_r) = 2 sigma_w^2 (I - q_r q_r^T), and the residual has no part along q_r: a scalar weight.
        weighted = (0.5 * age_weights / self._gyro_variance)[:, None, None] * h_w
        self._rotation_moment *= decay
        self._rotation_moment += np.tensordot(weighted, h_w, ([0, 1], [0, 1]))

        weight = np.linalg.inv(self._translation_noise())
        self._translation_moment *= decay
        self._translation_moment += np.tensordot(age_weights[:, None, None] * h, weight @ h, ([0, 1], [0, 1]))
        self._noise_share *= decay
        self._noise_share += age_weights.sum() * sum(u.T @ weight @ u for u in (*_LEFT_UNITS, *_RIGHT_UNITS))
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
        ww, wv = self._translation_moment[:4, :4], self._translation_moment[:4, 4:]
        across = right_multiplication(q_r)[:, 1:]  # q_d is orthogonal to q_r
        ratios = np.linalg.eigvals(np.linalg.solve(across.T @ noise_ww @ across, across.T @ ww @ across))
        smallest = float(ratios.real.min())
        ww = ww - min(1.0, 0.5 * smallest) * noise_ww
        q_d = solve_translation(q_r, ww, wv)
        self._set(q_r, q_d, self._covariance_of_steps(dual_tangent(q_r, q_d), ww, wv))

    def _covariance_of_steps(self, derivative: Array, ww: Array, wv: Array) -> Array:
        """Covariance (6, 6): first the rotation from its own equation, then the translation that goes with it."""
        prior = _PRIOR_STD**-2.0
        rotation_information = derivative[:4, :3].T @ self._rotation_moment @ derivative[:4, :3]
        rotation_covariance = np.linalg.inv(rotation_information + prior[0] * np.eye(3))
        by_theta, by_translation = derivative[:, :3], derivative[4:, 3:]
        translation_covariance = np.linalg.inv(by_translation.T @ ww @ by_translation + prior[3] * np.eye(3))
        follow = -translation_covariance @ by_translation.T @ (ww @ by_theta[4:] + wv @ by_theta[:4])
        coupling = follow @ rotation_covariance
        return np.block([[rotation_covariance, coupling.T], [coupling, translation_covariance + coupling @ follow.T]])

    def _set(self, q_r: Array, q_d: Array, covariance: Array) -> None:
        self._q_r, self._q_d, self._covariance = q_r, q_d, covariance
        derivative = dual_tangent(q_r, q_d)
        self._spread = np.diag(derivative @ covariance @ derivative.T)

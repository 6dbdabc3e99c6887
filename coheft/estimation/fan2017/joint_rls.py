"""Joint recursive least squares for inertia, centre of mass and mass (Fan et al., eqs 28-30 and 33).

The unknown is ``theta = (J, h, 1/m)``: J packed (6), h (3) [m], 1/m [1/kg]; linear in

``[Om(alpha) + [w]x Om(w) | -[F]x | 0] theta = T`` and ``[0 | [alpha]x + [w]x^2 | -F] theta = -a``.

What is known beforehand goes over to the right-hand side: with h known that leaves eq. (26) for J and eq. (27) for m,
with J known eq. (25) for h, and so on.

The projection of the second on the complement of F (eq. 24) follows from it and adds nothing once both are weighted by
their noise, so it is not stacked a second time.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from coheft.estimation.geometry.spatial import Array, skew
from coheft.estimation.rigid_body.mass_properties import euler_regressor, unpack_symmetric

_PRIOR_STD = np.array([10.0] * 6 + [1.0] * 3 + [1.0])
_KNOWN_STD = 1e-6
"""Of what is known beforehand: next to nothing, and yet the covariance has an inverse."""


def joint_regressor(w: Array, a: Array, alpha: Array, force: Array, torque: Array) -> tuple[Array, Array]:
    """Observation matrix and right-hand side of eq. (30) for samples of shape (B, 3) each.

    Returns:
        Shapes (B, 6, 10) and (B, 6).
    """
    matrix = np.zeros((len(w), 6, 10))
    cross_w = skew(w)
    matrix[:, :3, :6] = euler_regressor(w, alpha)
    matrix[:, :3, 6:9] = -skew(force)
    matrix[:, 3:, 6:9] = skew(alpha) + cross_w @ cross_w
    matrix[:, 3:, 9] = -force
    return matrix, np.concatenate([torque, -a], axis=1)


class JointRls:
    """Recursive least squares with exponential forgetting for ``(J, h, 1/m)``.

    The prior (h at the centre of the grasps, all else next to unknown) is never forgotten: it bounds the covariance
    when nothing moves.

    Args:
        centre: Geometric centre of all grasps, the initial guess of h, shape (3,) [m].
        wrench_covariance: Of the noise of the total wrench ``(F, T)``, shape (6, 6).
        motion_covariance: Of the noise of ``(a, alpha)``, shape (6, 6).
        forgetting: Factor per sample by which older samples count less.
        mass: Initial guess of the mass [kg].
        known: What is known beforehand, by index of theta.
        is_weighted_by_state: Whether observations are weighted by their noise as it is at the present estimate; else by
            a constant, the noise of T and of a.
    """

    def __init__(
        self,
        centre: Array,
        wrench_covariance: Array,
        motion_covariance: Array,
        forgetting: float,
        *,
        mass: float = 1.0,
        known: Mapping[int, float] | None = None,
        is_weighted_by_state: bool = True,
    ) -> None:
        self._noise = np.zeros((12, 12))
        self._noise[:6, :6] = wrench_covariance
        self._noise[6:, 6:] = motion_covariance
        self._forgetting = forgetting
        self._prior = np.diag(_PRIOR_STD**-2.0)
        self._guess = np.concatenate([np.zeros(6), centre, [1.0 / mass]])
        self._known = np.array(sorted(known or {}), dtype=int)
        self._guess[self._known] = [(known or {})[k] for k in self._known]
        self._free = np.setdiff1d(np.arange(10), self._known)
        self._is_weighted_by_state = is_weighted_by_state
        self._information = np.zeros((10, 10))
        self._vector = np.zeros(10)
        self._residual_sum = 0.0
        self._count = 0.0
        self.theta: Array = self._guess.copy()
        self.surprise = 0.0
        """Mean squared normalised residual of the last block before it was taken in, relative to that of the past."""

    def update(self, w: Array, a: Array, alpha: Array, force: Array, torque: Array) -> None:
        """Take in a block: body motion and total wrench in ``F_i``, shape (B, 3) each."""
        matrix, right_side = joint_regressor(w, a, alpha, force, torque)
        weight = np.linalg.inv(self._equation_covariance())
        residual = right_side - matrix @ self.theta
        squares = np.einsum("bi,ij,bj->b", residual, weight, residual)
        if self._count > 0.0:
            expected = max(self._residual_sum / self._count, 1.0)
            self.surprise = float(squares.mean()) / 6.0 / expected

        age_weights = self._forgetting ** np.arange(len(w) - 1, -1, -1.0)
        decay = self._forgetting ** len(w)
        weighted = age_weights[:, None, None] * (weight @ matrix)
        self._information = decay * self._information + np.tensordot(matrix, weighted, ([0, 1], [0, 1]))
        self._vector = decay * self._vector + np.tensordot(weighted, right_side, ([0, 1], [0, 1]))
        right = (self._vector + self._prior @ self._guess)[self._free]
        right -= self._information[np.ix_(self._free, self._known)] @ self._guess[self._known]
        self.theta = self._guess.copy()
        self.theta[self._free] = self._covariance_of_free() @ right
        residual = right_side - matrix @ self.theta
        squares = np.einsum("bi,ij,bj->b", residual, weight, residual)
        self._residual_sum = decay * self._residual_sum + float(age_weights @ squares)
        self._count = decay * self._count + 6.0 * float(age_weights.sum())

    @property
    def covariance(self) -> Array:
        """Of theta, shape (10, 10); grown where residuals are larger than the sensors' noise explains."""
        scale = max(self._residual_sum / self._count, 1.0) if self._count > 0.0 else 1.0
        result = _KNOWN_STD**2 * np.eye(10)
        result[np.ix_(self._free, self._free)] = scale * self._covariance_of_free()
        return result

    def _covariance_of_free(self) -> Array:
        """Of what is not known beforehand, if noise is as large as it is said to be."""
        information = (self._information + self._prior)[np.ix_(self._free, self._free)]
        return np.linalg.inv(information).astype(np.float64)

    def _equation_covariance(self) -> Array:
        """Covariance (6, 6) of both equations' noise at the current estimate (Fan et al., Proposition 2).

        ``T`` enters by itself, ``F`` through ``h x F`` and ``F / m``, ``alpha`` through ``J alpha`` and ``alpha x h``.
        """
        if not self._is_weighted_by_state:
            return self._noise[3:9, 3:9]
        tensor, h, inverse_mass = unpack_symmetric(self.theta[:6]), self.theta[6:9], self.theta[9]
        by_noise = np.zeros((6, 12))  # columns: F, T, a, alpha
        by_noise[:3, :3] = -skew(h)
        by_noise[:3, 3:6] = np.eye(3)
        by_noise[:3, 9:] = -tensor
        by_noise[3:, :3] = inverse_mass * np.eye(3)
        by_noise[3:, 6:9] = -np.eye(3)
        by_noise[3:, 9:] = skew(h)
        covariance: Array = by_noise @ self._noise @ by_noise.T
        return covariance

"""Joint recursive least squares for inertia, centre of mass and mass (Fan et al., eqs 28-30 and 33).

The unknown is ``theta = (J, h, 1/m)``: J packed (6), h (3) [m], 1/m [1/kg]; linear in

``[Om(alpha) + [w]x Om(w) | -[F]x | 0] theta = T`` and ``[0 | [alpha]x + [w]x^2 | -F] theta = -a``.

What is known beforehand goes over to the right-hand side: with h known that leaves eq. (26) for J and eq. (27) for m,
with J known eq. (25) for h, and so on.

The total force is measured and stands in the regressor: what its noise adds to the moments on average is taken out, or
the mass would come out wrong by several standard deviations (Proposition 2 has the covariance only). The noise of alpha
stays in: how large that of the team's mean is no robot knows, and to take out too much makes it worse.

The projection of the second on the complement of F (eq. 24) follows from it and adds nothing once both are weighted by
their noise, so it is not stacked a second time.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from coheft.estimation.geometry.spatial import Array, skew
from coheft.estimation.rigid_body.mass_properties import euler_regressor

_PRIOR_STD = np.array([10.0] * 6 + [1.0] * 3 + [1.0])
_KNOWN_STD = 1e-6
"""Of what is known beforehand: next to nothing, and yet the covariance has an inverse."""
_INPUTS = 12
"""Numbers per sample that are measured: total force and torque, a, alpha."""


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


def _by_inputs() -> tuple[Array, Array]:
    """Derivatives of ``joint_regressor`` by ``(F, T, a, alpha)``, shapes (12, 6, 10) and (12, 6)."""
    force, torque, a, alpha = np.eye(_INPUTS).reshape(_INPUTS, 4, 3).transpose(1, 0, 2)
    return joint_regressor(np.zeros((_INPUTS, 3)), a, alpha, force, torque)


_MATRIX_BY_INPUTS, _RIGHT_SIDE_BY_INPUTS = _by_inputs()


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
        causes: ``K``, numbers that may be off as long as the filter runs, such as those of a frozen pose.
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
        causes: int = 0,
    ) -> None:
        self._noise = np.zeros((12, 12))
        self._noise[:6, :6] = wrench_covariance
        # What noise of the wrench adds to information and vector, (10, 11), is linear in the weight, (6, 6).
        wrench_noise = np.tensordot(wrench_covariance, _MATRIX_BY_INPUTS[:6], 1)
        both = np.concatenate([_MATRIX_BY_INPUTS[:6], _RIGHT_SIDE_BY_INPUTS[:6, :, None]], axis=2)
        self._noise_by_weight = np.einsum("kia,kjb->abij", wrench_noise, both).reshape(110, 36)
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
        self._noise_information = np.zeros((10, 10))
        self._noise_vector = np.zeros(10)
        self._pull = np.zeros((10, causes))
        self._old: tuple[Array, Array] | None = None
        self._residual_sum = 0.0
        self._count = 0.0
        self.theta: Array = self._guess.copy()
        self.surprise = 0.0
        """Mean squared normalised residual of the last block before it was taken in, relative to that of the past."""

    def update(
        self, w: Array, a: Array, alpha: Array, force: Array, torque: Array, by_causes: Array | None = None
    ) -> None:
        """Take in a block.

        Args:
            w: Body motion in ``F_i``: angular velocity, shape (B, 3) [rad/s].
            a: Proper acceleration, shape (B, 3) [m/s²].
            alpha: Angular acceleration, shape (B, 3) [rad/s²].
            force: Total force in ``F_i``, shape (B, 3) [N].
            torque: Total torque about the origin of ``F_i``, shape (B, 3) [N·m].
            by_causes: By what ``(F, T, a, alpha)`` are off for each unit of what may be off, shape (b, 12, K): of every
                sample or, as it changes as slowly as the motion, of every second, third, ..., from the first on.
        """
        matrix, right_side = joint_regressor(w, a, alpha, force, torque)
        by_inputs = self._residual_by_inputs()
        weight = np.linalg.inv(self._equation_covariance(by_inputs))
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
        self._noise_information, self._noise_vector = decay * self._noise_information, decay * self._noise_vector
        if self._is_weighted_by_state:  # basic least squares takes the regressor to be exact
            noise = float(age_weights.sum()) * (self._noise_by_weight @ weight.ravel()).reshape(10, 11)
            self._noise_information += noise[:, :10]
            self._noise_vector += noise[:, 10]
        if self._old is not None:
            self._old = decay * self._old[0], decay * self._old[1]
        self._pull *= decay
        if by_causes is not None:
            every = -(-len(w) // len(by_causes))
            self._pull += every * np.tensordot(weighted[::every], by_inputs @ by_causes, ([0, 1], [0, 1]))
        self._solve()
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

    @property
    def by_causes(self) -> Array:
        """What theta is off for each unit of what may be off, shape (10, K)."""
        result = np.zeros_like(self._pull)
        result[self._free] = self._covariance_of_free() @ self._pull[self._free]
        return result

    def note_better(self, factor: float) -> None:
        """What may be off is so much smaller from now on, while what has been taken in was off by more."""
        self._pull /= factor

    def note_change(self) -> None:
        """The load has changed: what has been taken in so far is of another one."""
        self._old = self._information.copy(), self._vector.copy()

    @property
    def pull_of_old(self) -> Array:
        """What old samples of another load pull theta by, shape (10,): zeros where there are none."""
        pull = np.zeros(10)
        if self._old is not None:
            information, vector = self._information - self._old[0], self._vector - self._old[1]
            pull[self._free] = self.theta[self._free] - self._solution(information, vector)
        return pull

    def _solve(self) -> None:
        """Theta, without what noise adds to the moments, as far as there is more than noise in them."""
        free = np.ix_(self._free, self._free)
        # The largest ratio of noise to information in any direction is at most the sum of all.
        ratios = np.linalg.solve((self._information + self._prior)[free], self._noise_information[free])
        share = min(1.0, 0.5 / max(float(np.trace(ratios)), 1e-12))
        self.theta = self._guess.copy()
        self.theta[self._free] = self._solution(
            self._information - share * self._noise_information, self._vector - share * self._noise_vector
        )

    def _solution(self, information: Array, vector: Array) -> Array:
        """What is not known beforehand, by these moments and the prior."""
        right = (vector + self._prior @ self._guess)[self._free]
        right -= information[np.ix_(self._free, self._known)] @ self._guess[self._known]
        return np.linalg.solve((information + self._prior)[np.ix_(self._free, self._free)], right)

    def _covariance_of_free(self) -> Array:
        """Of what is not known beforehand, if noise is as large as it is said to be."""
        information = (self._information + self._prior)[np.ix_(self._free, self._free)]
        return np.linalg.inv(information).astype(np.float64)

    def _equation_covariance(self, by_inputs: Array) -> Array:
        """Covariance (6, 6) of both equations' noise at the current estimate (Fan et al., Proposition 2)."""
        if not self._is_weighted_by_state:
            return self._noise[3:9, 3:9]
        covariance: Array = by_inputs @ self._noise @ by_inputs.T
        return covariance

    def _residual_by_inputs(self) -> Array:
        """Derivative (6, 12) of both equations' residual by ``(F, T, a, alpha)`` at the current estimate.

        ``T`` enters by itself, ``F`` through ``h x F`` and ``F / m``, ``alpha`` through ``J alpha`` and ``alpha x h``.
        """
        derivative: Array = (_RIGHT_SIDE_BY_INPUTS - _MATRIX_BY_INPUTS @ self.theta).T
        return derivative

"""Joint recursive least squares for inertia, centre of mass and mass (Fan et al., eqs 28-30 and 33).

The unknown is ``theta = (J, h, 1/m)``: J packed (6), h (3) [m], 1/m [1/kg]; linear in

``[Om(alpha) + [w]x Om(w) | -[F]x | 0] theta = T`` and ``[0 | [alpha]x + [w]x^2 | -F] theta = -a``.

What is known beforehand goes over to the right-hand side: with h known that leaves eq. (26) for J and eq. (27) for m,
with J known eq. (25) for h, and so on.

Total force and alpha are measured and stand in the regressor: what their noise adds to the moments on average is taken
out, or mass and inertia would come out wrong by several standard deviations (Proposition 2 has the covariance only).
How large the noise of a sum over the team is follows from no robot's own data sheet. The load moves smoothly, so it is
measured, by fifth differences of samples.

The projection of the second on the complement of F (eq. 24) follows from it and adds nothing once both are weighted by
their noise, so it is not stacked a second time.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np

from coheft.estimation.geometry.spatial import Array, skew
from coheft.estimation.rigid_body.mass_properties import euler_regressor

_PRIOR_STD = np.array([10.0] * 6 + [1.0] * 3 + [1.0])
_KNOWN_STD = 1e-6
"""Of what is known beforehand: next to nothing, and yet the covariance has an inverse."""
_INPUTS = 12
"""Numbers per sample that are measured: total force and torque, a, alpha."""
_AS_STATED = 100.0
"""So many samples count as having had the residuals that are expected, before any is seen."""
_GUESSED = 10.0
"""So many samples count as having been as noisy as is guessed, before noise is measured."""
_LEAST = 0.01
"""So much of the guessed variance is there in any case: where nothing moves, coarse sensors show none."""
_LEARNT = 50.0
"""Of noise that has been measured over so many samples, none is ever again so much larger: the load has changed."""
_JUMP = 9.0
"""So much larger its variance would have to be."""
_MOST_NOISE = 0.5
"""No more of the information in any direction is taken out as noise."""
_FADE = 2
"""What the first samples weigh follows from the guess, and may be far too much: of k samples number j counts
``(j / k)`` to this power."""
_EQUATION_OF = np.array([0] * 9 + [1])
"""Which of the two equations tells each number of theta: torques tell of J and h, forces of 1/m."""


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
        wrench_covariance: Of the noise of the total wrench ``(F, T)``, shape (6, 6), before it is measured.
        motion_covariance: Of the noise of ``(a, alpha)``, shape (6, 6), likewise.
        forgetting: Factor per sample by which older samples count less.
        is_alpha_shared: Whether all robots of the team have the same ``alpha``, as they have the same total wrench.
        mass: Initial guess of the mass [kg].
        known: What is known beforehand, by index of theta.
        is_weighted_by_state: Whether observations are weighted by their noise as it is at the present estimate; else by
            a constant, the noise of T and of a.
        causes: ``K``, numbers that may be off as long as the filter runs, such as those of a frozen pose.

    Attributes:
        theta: The estimate, shape (10,).
        surprise: Mean squared normalised residual of the last block before it was taken in, relative to the usual one.
    """

    def __init__(
        self,
        centre: Array,
        wrench_covariance: Array,
        motion_covariance: Array,
        forgetting: float,
        *,
        is_alpha_shared: bool = True,
        mass: float = 1.0,
        known: Mapping[int, float] | None = None,
        is_weighted_by_state: bool = True,
        causes: int = 0,
    ) -> None:
        self.theta: Array = np.concatenate([np.zeros(6), centre, [1.0 / mass]])
        self.surprise = 0.0
        self._known = np.array(sorted(known or {}), dtype=int)
        self.theta[self._known] = [(known or {})[k] for k in self._known]
        self._free = np.setdiff1d(np.arange(10), self._known)
        # From here on all is of what is not known beforehand, n numbers.
        n = len(self._free)
        self._guess = self._newest = self.theta[self._free]
        self._prior = self._information = np.diag(_PRIOR_STD[self._free] ** -2.0)
        self._by_inputs = _split(_MATRIX_BY_INPUTS, _RIGHT_SIDE_BY_INPUTS, self.theta, self._known, self._free)
        self._stated_noise = np.zeros((12, 12))
        self._stated_noise[:6, :6], self._stated_noise[6:, 6:] = wrench_covariance, motion_covariance
        self._noise_sum, self._noise_count = _GUESSED * self._stated_noise, _GUESSED
        self._own_inputs = slice(6, 9 if is_alpha_shared else 12)
        self._forgetting = forgetting
        self._is_weighted_by_state = is_weighted_by_state
        # Of all samples, and of those before the load changed: information, vector, and what noise adds to both.
        self._sums, self._old = np.zeros((2, n, 2 * n + 2))
        self._has_changed = False
        self._common_scatter, self._own_scatter = np.zeros((2, n, n))
        self._pull = np.zeros((n, causes))
        self._taken = 0
        self._squares, self._count = np.full(6, _AS_STATED), _AS_STATED

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
        both = _split(*joint_regressor(w, a, alpha, force, torque), self.theta, self._known, self._free)
        matrix, right_side = both[:, :, :-1], both[:, :, -1]
        decay, age_weights = self._weights_of(len(w))
        samples = float(age_weights.sum())
        self._measure_noise(np.hstack([force, torque, a, alpha]), decay)
        # Derivative (6, 12) of both equations' residual by (F, T, a, alpha), and by Proposition 2 their noise, (6, 6).
        by_inputs = (self._by_inputs[:, :, -1] - self._by_inputs[:, :, :-1] @ self.theta[self._free]).T
        noise_of_inputs = self._noise_sum / self._noise_count + _LEAST * self._stated_noise
        noise = by_inputs @ noise_of_inputs @ by_inputs.T
        weight = np.linalg.inv(noise if self._is_weighted_by_state else self._stated_noise[3:9, 3:9])
        squares = np.square(right_side - matrix @ self._newest) / noise.diagonal()
        self.surprise = float(squares.mean()) / max(float(self._squares.mean()) / self._count, 1.0)

        weighted = age_weights[:, None, None] * (weight @ matrix)
        self._sums *= decay
        if self._has_changed:
            self._old *= decay
        n = len(self._free)
        self._sums[:, : n + 1] += _over_samples(weighted, both)
        if self._is_weighted_by_state:  # basic least squares takes the regressor to be exact
            in_regressor = np.tensordot(noise_of_inputs, weight @ self._by_inputs, 1)
            self._sums[:, n + 1 :] += samples * _over_samples(self._by_inputs, in_regressor)[:-1]
        by_own = by_inputs[:, self._own_inputs]
        own_noise = by_own @ noise_of_inputs[self._own_inputs, self._own_inputs] @ by_own.T
        self._common_scatter = decay**2 * self._common_scatter + _over_samples(weighted, (noise - own_noise) @ weighted)
        self._own_scatter = decay**2 * self._own_scatter + _over_samples(weighted, own_noise @ weighted)
        self._pull *= decay
        if by_causes is not None:
            every = -(-len(w) // len(by_causes))
            self._pull += every * _over_samples(weighted[::every], by_inputs @ by_causes)
        self._solve()
        squares = np.square(right_side - matrix @ self._newest) / noise.diagonal()
        self._squares = decay * self._squares + age_weights @ squares
        self._count = decay * self._count + samples

    def _weights_of(self, samples: int) -> tuple[float, Array]:
        """What is left of the weight of older samples, and the weights of so many new ones, shape (samples,)."""
        weights = self._forgetting ** np.arange(samples - 1, -1, -1.0)
        decay = self._forgetting**samples
        if self._is_weighted_by_state:
            places = np.arange(self._taken, self._taken + samples + 1) / (self._taken + samples)
            decay *= float(places[0]) ** _FADE
            weights *= places[1:] ** _FADE
        self._taken += samples
        return decay, weights

    def covariance(self, agreeing: int = 1) -> Array:
        """Of the mean of the thetas of so many robots, shape (10, 10), by noise that is as large as residuals are.

        Noise of what all have alike does not average out. Weights that fall with age make it about half the inverse of
        the information: the square of a weight falls twice as fast.
        """
        inverse = np.linalg.inv(self._information)
        scatter = self._common_scatter + self._own_scatter / agreeing
        stds = np.sqrt(self._squares.reshape(2, 3).mean(axis=1) / self._count)[_EQUATION_OF][self._free]
        result = np.outer(stds, stds) * (inverse @ scatter @ inverse) + inverse @ self._prior @ inverse
        # Noise that was not taken out holds theta near the guess, which may be as far off as the prior lets it.
        left = (1.0 - self._share_taken_out(self._sums)) * self._sums[:, len(self._free) + 1 : -1]
        held = inverse @ left @ np.diag(_PRIOR_STD[self._free])
        return self._all(result + held @ held.T) + _KNOWN_STD**2 * np.eye(10)

    @property
    def by_causes(self) -> Array:
        """What theta is off for each unit of what may be off, shape (10, K)."""
        result = np.zeros((10, self._pull.shape[1]))
        result[self._free] = np.linalg.solve(self._information, self._pull)
        return result

    def note_better(self, factor: float) -> None:
        """What may be off is so much smaller from now on, while what has been taken in was off by more."""
        self._pull /= factor

    def note_change(self) -> None:
        """The load has changed: what has been taken in so far is of another one."""
        self._old, self._has_changed = self._sums.copy(), True

    @property
    def covariance_of_old(self) -> Array:
        """What old samples of another load pull theta by, as a covariance, shape (10, 10): zeros where there are none.

        Without them theta would be another one, which is not known better than the samples since then tell.
        """
        if not self._has_changed:
            return np.zeros((10, 10))
        pull = self.theta[self._free] - self._newest
        follow = np.linalg.solve(self._information, self._old[:, : len(pull)])
        newest = np.linalg.inv(self._moments(self._sums - self._old)[0])
        return self._all(np.outer(pull, pull) + follow @ newest @ follow.T)

    def _solve(self) -> None:
        self._information, vector = self._moments(self._sums)
        self.theta[self._free] = np.linalg.solve(self._information, vector)
        self._newest = self.theta[self._free]
        if self._has_changed:
            self._newest = np.linalg.solve(*self._moments(self._sums - self._old))

    def _moments(self, sums: Array) -> tuple[Array, Array]:
        """Information and vector, with the prior and without what noise adds, as far as there is more than noise."""
        n, share = len(self._free), self._share_taken_out(sums)
        information = sums[:, :n] + self._prior - share * sums[:, n + 1 : -1]
        return information, sums[:, n] - share * sums[:, -1] + self._prior @ self._guess

    def _share_taken_out(self, sums: Array) -> float:
        """How much of what noise adds can be taken out."""
        n = len(self._free)
        ratios = np.linalg.solve(sums[:, :n] + self._prior, sums[:, n + 1 : -1])
        largest = float(np.trace(ratios))  # no less than the ratio in any direction
        if largest > _MOST_NOISE:
            largest = float(np.linalg.eigvals(ratios).real.max())
        return min(1.0, _MOST_NOISE / max(largest, 1e-12))

    def _measure_noise(self, inputs: Array, decay: float) -> None:
        """Learn of the noise of ``(F, T, a, alpha)``, shape (B, 12), from what differs from any smooth motion."""
        differences = _fifth_differences(len(inputs))
        if not len(differences):
            return
        rough = differences @ inputs
        squares = rough.T @ rough
        usual = _JUMP * len(differences) / self._noise_count * self._noise_sum.diagonal()
        if self._noise_count < _LEARNT or np.all(squares.diagonal() < usual):
            self._noise_sum = decay * self._noise_sum + squares
            self._noise_count = decay * self._noise_count + len(differences)

    def _all(self, of_free: Array) -> Array:
        """A covariance with zeros for what is known beforehand."""
        result = np.zeros((10, 10))
        result[np.ix_(self._free, self._free)] = of_free
        return result


def _split(matrix: Array, right_side: Array, theta: Array, known: Array, free: Array) -> Array:
    """Columns of what is not known, (.., 6, n), and the right-hand side with all that is: shape (.., 6, n + 1)."""
    right = right_side - matrix[:, :, known] @ theta[known] if len(known) else right_side
    return np.concatenate([matrix[:, :, free] if len(known) else matrix, right[:, :, None]], axis=2)


def _over_samples(left: Array, right: Array) -> Array:
    """``sum left^T right`` over samples, shapes (B, 6, k) and (B, 6, l) to (k, l)."""
    result: Array = left.reshape(-1, left.shape[2]).T @ right.reshape(-1, right.shape[2])
    return result


@cache
def _fifth_differences(samples: int) -> Array:
    """What makes fifth differences of samples, with the variance of white noise; (samples - 5, samples)."""
    return np.diff(np.eye(samples), 5, axis=0) / np.sqrt(252.0) if samples > 5 else np.zeros((0, samples))

"""Joint recursive least squares for inertia, centre of mass and mass (Fan et al., eqs 28-30 and 33).

The unknown is ``theta = (J, h, 1/m)``: J packed (6), h (3) [m], 1/m [1/kg]; linear in

``[Om(alpha) + [w]x Om(w) | -[F]x | 0] theta = T`` and ``[0 | [alpha]x + [w]x^2 | -F] theta = -a``.

What is known beforehand goes over to the right-hand side: with h known that leaves eq. (26) for J and eq. (27) for m,
with J known eq. (25) for h, and so on.

Total force and alpha are measured and stand in the regressor: what their noise adds to the moments on average is taken
out, or mass and inertia would come out wrong by several standard deviations (Proposition 2 has the covariance only).

The projection of the second on the complement of F (eq. 24) follows from it and adds nothing once both are weighted by
their noise, so it is not stacked a second time.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from coheft.estimation.fan2017.forgetting import age_weights
from coheft.estimation.fan2017.input_noise import InputNoise
from coheft.estimation.geometry.observability import doubt_of
from coheft.estimation.geometry.spatial import Array, skew
from coheft.estimation.linear_algebra import inverse
from coheft.estimation.rigid_body.mass_properties import euler_regressor

_PRIOR_STD = np.array([10.0] * 6 + [1.0] * 3 + [1.0])
_KNOWN_STD = 1e-6
"""Of what is known beforehand: next to nothing, and yet the covariance has an inverse."""
_ROUNDING = 1e-12
_SINGULAR = 1e-9
"""Share of each variance that is added to a covariance, because a single block leaves it singular."""


def joint_regressor(w: Array, a: Array, alpha: Array, force: Array, torque: Array) -> tuple[Array, Array]:
    """Matrix (B, 6, 10) and right-hand side (B, 6) of eq. (30) for samples of shape (B, 3) each."""
    matrix = np.zeros((len(w), 6, 10))
    cross_w = skew(w)
    matrix[:, :3, :6] = euler_regressor(w, alpha)
    matrix[:, :3, 6:9] = -skew(force)
    matrix[:, 3:, 6:9] = skew(alpha) + cross_w @ cross_w
    matrix[:, 3:, 9] = -force
    return matrix, np.concatenate([torque, -a], axis=1)


def _by_inputs() -> tuple[Array, Array]:
    """Derivatives of ``joint_regressor`` by ``(F, T, a, alpha)``, shapes (12, 6, 10) and (12, 6)."""
    force, torque, a, alpha = np.eye(12).reshape(12, 4, 3).transpose(1, 0, 2)
    return joint_regressor(np.zeros((12, 3)), a, alpha, force, torque)


_MATRIX_BY_INPUTS, _RIGHT_SIDE_BY_INPUTS = _by_inputs()


@dataclass(frozen=True, eq=False)
class _Solution:
    """Theta by some moments, of n numbers that are not known beforehand.

    Attributes:
        theta: Shape (n,).
        inverse: Of the information without what noise adds, positive definite, shape (n, n).
        by_guess: What theta is off for each unit of what the guess is off: prior and noise that was not taken out hold
            it there; shape (n, n).
    """

    theta: Array
    inverse: Array
    by_guess: Array


class JointRls:
    """Recursive least squares with exponential forgetting for ``(J, h, 1/m)``.

    The prior (h at the centre of the grasps, all else next to unknown) is never forgotten: it bounds the covariance
    when nothing moves.

    Args:
        centre: Geometric centre of all grasps, the initial guess of h, shape (3,) [m].
        wrench_covariance: Of the noise of the total wrench ``(F, T)``, shape (6, 6), before it is measured.
        motion_covariance: Of the noise of ``(a, alpha)``, shape (6, 6), likewise.
        forgetting: Factor per sample by which older samples count less.
        mass: Initial guess of the mass [kg].
        known: What is known beforehand, by index of theta.
        is_weighted_by_state: Whether observations are weighted by their noise as it is at the present estimate; else by
            a constant, the noise of T and of a.

    Attributes:
        theta: The estimate, shape (10,).
        surprise: Mean squared normalised residual of the last block before it was taken in, relative to the usual one.
        moved: Move of theta by the residuals of the last block, without the effect of the lag, shape (10,).
        decay: Factor by which the last block reduced the weight of older samples.
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
        self.theta: Array = np.concatenate([np.zeros(6), centre, [1.0 / mass]])
        self.surprise = 0.0
        self.moved, self.decay = np.zeros(10), 1.0
        self._known = np.array(sorted(known or {}), dtype=int)
        self.theta[self._known] = [(known or {})[k] for k in self._known]
        self._free = np.setdiff1d(np.arange(10), self._known)
        # From here on all is of what is not known beforehand, n numbers.
        n = len(self._free)
        self._guess = self.theta[self._free]
        self._prior = np.diag(_PRIOR_STD[self._free] ** -2.0)
        self._by_inputs = _split(_MATRIX_BY_INPUTS, _RIGHT_SIDE_BY_INPUTS, self.theta, self._known, self._free)
        stated = np.zeros((12, 12))
        stated[:6, :6], stated[6:, 6:] = wrench_covariance, motion_covariance
        self._constant_noise = stated[3:9, 3:9]
        self._noise = InputNoise(stated)
        self._forgetting = forgetting
        self._is_weighted_by_state = is_weighted_by_state
        # Of samples since the load changed, and of those before: information, vector, and what noise adds to both.
        self._sums, self._old = np.zeros((2, n, 2 * n + 2))
        self._count, self._old_count = 0.0, 0.0
        self._has_changed = False
        self._scatter = np.zeros((n, n))
        self._pull_of_pose_error, self._pull_of_lag = np.zeros((n, 6)), np.zeros(n)
        self._taken = 0
        self._squares = 0.0
        self._all = self._newest = self._solution(self._sums, self._count)

    def update(
        self,
        w: Array,
        a: Array,
        alpha: Array,
        force: Array,
        torque: Array,
        by_pose_error: Array | None = None,
        lag: Array | None = None,
        mean_com: Array | None = None,
    ) -> None:
        """Take in a block.

        Args:
            w: Body motion in ``F_i``: angular velocity, shape (B, 3) [rad/s].
            a: Proper acceleration, shape (B, 3) [m/s²].
            alpha: Angular acceleration, shape (B, 3) [rad/s²].
            force: Total force in ``F_i``, shape (B, 3) [N].
            torque: Total torque about the origin of ``F_i``, shape (B, 3) [N·m].
            by_pose_error: Errors of ``(F, T, a, alpha)`` per unit of the robot's own pose error, shape (b, 12, 6): of
                every sample or, as they change as slowly as the motion, of every second, third, ..., from the first on.
            lag: Errors of ``(F, T, a, alpha)`` by the lag of the sums, of the same samples, shape (b, 12).
            mean_com: Centre of mass in the robots' frames, their mean in the axes of ``F_i``, shape (3,) [m]: if all
                share alpha, its error ``e`` adds ``e x h_j`` to the force equation of robot j, and on average this.
                None where the robot's own estimate counts.
        """
        both = _split(*joint_regressor(w, a, alpha, force, torque), self.theta, self._known, self._free)
        self._noise.measure(np.hstack([force, torque, a, alpha]))
        # Derivative (6, 12) of both equations' residual by (F, T, a, alpha), and by Proposition 2 their noise, (6, 6).
        by_inputs = (self._by_inputs[:, :, -1] - self._by_inputs[:, :, :-1] @ self._all.theta).T
        noise = by_inputs @ self._noise.covariance @ by_inputs.T
        normal = inverse(noise)
        weight = normal if self._is_weighted_by_state else inverse(self._constant_noise)
        self.surprise = float(_squares(both, self._newest.theta, normal).mean()) / self._residual_scale

        self.decay, weights = decay, _ = self._weights_of(len(w))
        weighted = weights[:, None, None] * (weight @ both[:, :, :-1])
        n = len(self._free)
        self._old *= decay
        self._count = decay * self._count + float(weights.sum())
        self._old_count *= decay
        block = np.zeros_like(self._sums)
        block[:, : n + 1] = _over_samples(weighted, both)
        if self._is_weighted_by_state:  # basic least squares takes the regressor to be exact
            by_inputs_weighted = (weight @ self._by_inputs).reshape(12, 6 * (n + 1))
            in_regressor = (self._noise.covariance @ by_inputs_weighted).reshape(12, 6, n + 1)
            block[:, n + 1 :] = weights.sum() * _over_samples(self._by_inputs, in_regressor)[:-1]
        self._sums = decay * self._sums + block
        self._scatter = decay**2 * self._scatter + _over_samples(weighted, noise @ weighted)
        late = np.zeros(n)
        if lag is not None:  # it is in the regressor as well, so the mean of its effect is not zero
            every = -(-len(w) // len(lag))
            late = every * _over_samples(weighted[::every], (lag @ by_inputs.T)[:, :, None])[:, 0]
        self._pull_of_lag = decay * self._pull_of_lag + late
        self._pull_of_pose_error *= decay
        if by_pose_error is not None:
            every = -(-len(w) // len(by_pose_error))
            mean_by_inputs = by_inputs.copy()
            if mean_com is not None:
                mean_by_inputs[3:, 9:] = skew(mean_com)
            self._pull_of_pose_error += every * _over_samples(weighted[::every], mean_by_inputs @ by_pose_error)
        self._all = self._solution(self._sums + self._old, self._count + self._old_count)
        self._newest = self._solution(self._sums, self._count) if self._has_changed else self._all
        self.theta[self._free] = self._all.theta
        residual = (block[:, n + 1 :] - block[:, : n + 1]) @ np.append(self._newest.theta, -1.0)
        self.moved[self._free] = self._all.inverse @ (residual + late)
        self._squares = decay * self._squares + float(weights @ _squares(both, self._newest.theta, normal))

    def covariance(self, share: Array | None = None) -> Array:
        """Covariance of theta, or of the mean of all robots' thetas; larger where residuals exceed the noise.

        Weights that decrease with age make it about half the inverse of the information, because squares of weights
        decrease twice as fast.

        Args:
            share: ``MeanNoise.share``, shape (10, 10); None for the own theta.
        """
        root = self.noise_root
        held = self._all.by_guess @ np.diag(_PRIOR_STD[self._free])
        return (root @ root.T if share is None else root @ share @ root.T) + self._of_all(held @ held.T)

    @property
    def gain(self) -> Array:
        """By what theta moves for a unit of a block's residuals in the normal equations, shape (10, 10), invertible."""
        result = self._of_all(self._all.inverse)
        result[self._known, self._known] = 1.0
        return result

    @property
    def noise_root(self) -> Array:
        """Cholesky factor of the part of the covariance that white noise causes, shape (10, 10)."""
        noise = self._of_all(self._residual_scale * self._all.inverse @ self._scatter @ self._all.inverse)
        return np.asarray(np.linalg.cholesky(noise + np.diag(_SINGULAR * noise.diagonal() + _KNOWN_STD**2)))

    @property
    def by_pose_error(self) -> Array:
        """Error of theta per unit of the robot's own pose error, shape (10, 6)."""
        result = np.zeros((10, 6))
        result[self._free] = self._all.inverse @ self._pull_of_pose_error
        return result

    @property
    def by_lag(self) -> Array:
        """Error of theta by the lag of the sums, shape (10,)."""
        result = np.zeros(10)
        result[self._free] = self._all.inverse @ self._pull_of_lag
        return result

    def note_better(self, factor: float) -> None:
        """From now on the pose errors are smaller by this factor than they were for the samples so far."""
        self._pull_of_pose_error /= factor

    def note_change(self) -> None:
        """The load has changed: what has been taken in so far is of another one."""
        self._old, self._old_count, self._has_changed = self._old + self._sums, self._old_count + self._count, True
        self._sums, self._count = np.zeros_like(self._sums), 0.0

    @property
    def by_old(self) -> Array:
        """Error of theta by samples of another load, shape (10,): without them it would be another one."""
        result = np.zeros(10)
        result[self._free] = self._all.theta - self._newest.theta
        return result

    @property
    def covariance_of_old(self) -> Array:
        """Covariance of that error, shape (10, 10): it is not known better than the samples since then tell."""
        if not self._has_changed:
            return np.zeros((10, 10))
        follow = self._all.inverse @ self._old[:, : len(self._free)]
        return self._of_all(follow @ self._newest.inverse @ follow.T)

    def _weights_of(self, samples: int) -> tuple[float, Array]:
        """What is left of the weight of older samples, and the weights of so many new ones, shape (samples,).

        What the first samples weigh follows from the guess, and may be far too much: of k samples, number j counts
        ``j / k``.
        """
        weights, decay = age_weights(self._forgetting, samples), self._forgetting**samples
        if self._is_weighted_by_state:
            places = np.arange(self._taken, self._taken + samples + 1) / (self._taken + samples)
            decay *= float(places[0])
            weights = weights * places[1:]
        self._taken += samples
        return decay, weights

    @property
    def _residual_scale(self) -> float:
        """How much larger squared residuals are than noise explains, 1 at least; of the same samples as the sums."""
        return max(self._squares / max(self._count + self._old_count, 1.0), 1.0)

    def _solution(self, sums: Array, count: float) -> _Solution:
        """Theta by bias-compensated least squares (Stoica, Söderström 1982) with a prior, from moments of samples.

            theta = argmin  sum |A theta - y|_W^2 + |theta - guess|_P^2 - (theta^T N theta - 2 n^T theta)

        ``N`` and ``n`` are what noise of the regressor adds to ``A^T W A`` and ``A^T W y``. In a basis in which
        ``A^T W A + P`` is 1 and N diagonal, no more of N and n is subtracted than leaves as much information in each
        direction as may be noise beside its average.
        """
        n = len(self._free)
        information, vector, noise, noise_vector = np.split(sums, [n, n + 1, 2 * n + 1], axis=1)
        root: Array = np.asarray(np.linalg.cholesky(information + self._prior))
        white = inverse(root)
        noise_in_basis, eigenvectors = np.linalg.eigh(white @ noise @ white.T)
        basis = white.T @ eigenvectors
        noise_in_basis = np.maximum(noise_in_basis, _ROUNDING)
        remaining = np.maximum(1.0 - noise_in_basis, np.minimum(doubt_of(noise_in_basis, count), 1.0))
        compensated = (1.0 - remaining) / noise_in_basis  # share of N and n that is subtracted
        uncompensated = basis @ ((1.0 - compensated) / remaining * basis).T
        gain = (basis / remaining) @ basis.T
        vector_in_basis = basis.T @ (vector[:, 0] + self._prior @ self._guess)
        vector_in_basis = vector_in_basis - compensated * (basis.T @ noise_vector[:, 0])
        return _Solution(
            theta=basis @ (vector_in_basis / remaining),
            inverse=gain,
            by_guess=gain @ self._prior + uncompensated @ noise,
        )

    def _of_all(self, of_free: Array) -> Array:
        """A covariance with zeros for what is known beforehand."""
        if not len(self._known):
            return of_free
        result = np.zeros((10, 10))
        result[np.ix_(self._free, self._free)] = of_free
        return result


def _split(matrix: Array, right_side: Array, theta: Array, known: Array, free: Array) -> Array:
    """Columns of what is not known, (.., 6, n), and the right-hand side with all that is: shape (.., 6, n + 1)."""
    right = right_side - matrix[:, :, known] @ theta[known] if len(known) else right_side
    return np.concatenate([matrix[:, :, free] if len(known) else matrix, right[:, :, None]], axis=2)


def _over_samples(left: Array, right: Array) -> Array:
    """``sum left^T right`` over samples, shapes (B, 6, k) and (B, 6, l) to (k, l)."""
    rows = left.shape[0] * left.shape[1]
    return left.reshape(rows, left.shape[2]).T @ right.reshape(rows, right.shape[2])


def _squares(both: Array, theta: Array, normal: Array) -> Array:
    """Squared residuals of samples in units of their noise, per equation: 1 is usual; shape (B,)."""
    residual = both[:, :, -1] - both[:, :, :-1] @ theta
    result: Array = (residual @ normal * residual).sum(axis=1) / 6.0
    return result

"""Maximum-likelihood relative pose of two grasp frames from their twists.

For exact measurements ``xi_i = Ad(g) xi_j`` with ``xi = (w, v)`` and ``g = pose_j_in_i``. The residual
``r = xi_i - Ad(g) xi_j`` has covariance ``S(g) = Sigma_i + Ad(g) Sigma_j Ad(g)^T``. Summed over time, the likelihood
depends on the data only through the moments of ``(xi_i, xi_j)``: constant memory, one matrix product per block.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from coheft.estimation.body_motion import perturbed
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.observability import PoseEstimate, Visibility, doubt_of, seen_information
from coheft.estimation.spatial import CROSS_OF_AXES, Array, Pose, rotation_from_quaternion, skew

_POSES = 64
"""What follows from so many poses is kept."""

_STEPS = 12
_FAINT = 1e-12
"""Share of one sample's noise, and of all motion, that is rounding: where there is no more, frames are parallel."""
_CLOSE = 1e-6
"""Steps below this share of the standard deviation's limit end the iteration."""
_IDENTITY, _DIAGONAL = np.eye(6), np.arange(6)
_W_I, _V_I, _W_J, _V_J = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)


@dataclass(frozen=True, eq=False)
class TwistMoments:
    """Sums over samples that a pair's pose is found from. Add up those of several blocks.

    Attributes:
        gram: ``Z^T Z`` of the rows ``Z = (1, xi_i, xi_j)``, shape (13, 13).
    """

    gram: Array

    @staticmethod
    def none() -> TwistMoments:
        """Of no samples."""
        return TwistMoments(np.zeros((13, 13)))

    @staticmethod
    def of(twists_i: Array, twists_j: Array) -> TwistMoments:
        """Of simultaneous twists ``(w, v)``, each in its own frame, shape (n, 6) each.

        Raises:
            ValueError: Shapes do not fit.
        """
        if twists_i.shape[1:] != (6,) or twists_i.shape != twists_j.shape:
            raise ValueError(f"{twists_i.shape=} and {twists_j.shape=} but expected (n, 6) twice")
        rows = np.hstack([np.ones((len(twists_i), 1)), twists_i, twists_j])
        return TwistMoments(rows.T @ rows)

    def __add__(self, other: TwistMoments) -> TwistMoments:
        return TwistMoments(self.gram + other.gram)

    @property
    def count(self) -> float:
        """Number of samples."""
        return float(self.gram[0, 0])

    def second(self, centred: bool) -> tuple[Array, float]:
        """Sum of ``x x^T`` with ``x = (xi_i, xi_j)``, shape (12, 12), and how many samples' noise it holds.

        Centred, the means are removed first; constant offsets of gyros and velocities do not matter then.
        """
        if not centred:
            return self.gram[1:, 1:], self.count
        total, count = self.gram[0, 1:], max(self.count, 1.0)
        return self.gram[1:, 1:] - np.outer(total, total) / count, count - 1.0


def register_twists(
    moments: TwistMoments,
    noise_i: SensorNoise,
    noise_j: SensorNoise,
    centred: bool = True,
    limits: Visibility | None = None,
    start: Pose | None = None,
) -> PoseEstimate:
    """Maximum-likelihood ``pose_j_in_i``: a few Gauss-Newton steps from a closed-form start.

    The Jacobian holds the twist that both measurements together make most likely, not the raw one, so the noise does
    not bias the pose. That twist's own noise is subtracted from the information ``I``, and is what the score
    varies more than ``I`` says: the covariance is ``I^-1 (I + noise) I^-1``, exact for Gaussian noise.

    Args:
        moments: Of at least two samples.
        noise_i: Of robot i's sensors.
        noise_j: Of robot j's sensors.
        centred: Whether constant offsets of gyros and velocities are allowed for.
        limits: When a direction of the pose counts as seen.
        start: Where to start from instead of the closed form.
    """
    limits = limits or Visibility()
    second, count = moments.second(centred)
    sigma_i, sigma_j = (np.square(noise.per_column()[:6]) for noise in (noise_i, noise_j))
    pose = start or closed_form_pose(second, sigma_i, sigma_j)
    for _ in range(_STEPS):
        score, raw, noise = _score_and_information(pose, second, count, sigma_i, sigma_j)
        seen = seen_information(raw - noise, limits, doubt_of(noise, count))
        step = seen.step(score)
        pose = perturbed(pose, step)
        if np.all(np.abs(step) < _CLOSE * limits.scale()):
            break
    inverse = seen.inverse()
    covariance = inverse if seen.unseen_count else inverse + inverse @ noise @ inverse
    return PoseEstimate(pose, covariance, seen.unseen())


def mean_square(moments: TwistMoments, pose: Pose, noise_i: SensorNoise, noise_j: SensorNoise) -> float:
    """Mean square of the residuals ``xi_i - Ad(pose_j_in_i) xi_j`` in units of their noise, means left out.

    1 up to sampling if both sensors measure the same motion at the same time; other arguments as of
    ``register_twists``.
    """
    second, count = moments.second(centred=True)
    sigma_i, sigma_j = (np.square(noise.per_column()[:6]) for noise in (noise_i, noise_j))
    _, residual, weight = _weighted_residual(pose, sigma_i, sigma_j)
    return float(np.vdot(weight @ residual @ second, residual)) / (6.0 * max(count, 1.0))


def closed_form_pose(second: Array, sigma_i: Array, sigma_j: Array) -> Pose:
    """Global start: the quaternion that turns j's vectors into i's best, then the translation, both linear.

    Besides angular velocities it turns the velocities' parts that are linearly independent of ``w_i``: these obey
    ``v_i = R v_j`` whatever the translation, so the rotation is found also if all rotation is about one axis.
    Minimising ``|L(a) q - R(b) q|^2`` over unit quaternions is an eigenvalue problem (Davenport; Horn 1987); given
    ``q_r``, the dual part's equation ``v_i - R v_j = p x w_i`` is linear in ``p``. Without any motion the pose is the
    identity.

    Args:
        second: Sum of ``x x^T`` with ``x = (xi_i, xi_j)``, shape (12, 12).
        sigma_i: Variances of the noise of ``xi_i``, shape (6,).
        sigma_j: Likewise of ``xi_j``.
    """
    variance = sigma_i + sigma_j
    ridge = _FAINT * (np.trace(second) + variance[0]) * np.eye(3)
    explained = second[_V_I, _W_I] @ np.linalg.solve(second[_W_I, _W_I] + ridge, second[_W_I, _V_J])
    cross = second[_W_I, _W_J] / variance[0] + (second[_V_I, _V_J] - explained) / variance[3]
    trace, asymmetry = np.trace(cross), _vee(cross - cross.T)
    davenport = np.empty((4, 4))
    davenport[0, 0] = trace + _FAINT
    davenport[0, 1:] = davenport[1:, 0] = asymmetry
    davenport[1:, 1:] = cross + cross.T - trace * np.eye(3)
    rotation = rotation_from_quaternion(np.linalg.eigh(davenport)[1][:, -1])
    # sum of -[w]x [w]x p = sum of w x (v_i - R v_j); a weak pull to zero holds what the motion does not show.
    moment = second[_W_I, _V_I] - second[_W_I, _V_J] @ rotation.T
    spread = np.trace(second[_W_I, _W_I]) * np.eye(3) - second[_W_I, _W_I]
    translation = np.linalg.solve(spread + variance[3] * np.eye(3), _vee(moment.T - moment))
    return Pose(rotation, translation)


def _score_and_information(
    pose: Pose, second: Array, count: float, sigma_i: Array, sigma_j: Array
) -> tuple[Array, Array, Array]:
    """Score (6,), Gauss-Newton information (6, 6), and the part of it that is expected from noise alone (6, 6)."""
    carried, residual, weight = _weighted_residual(pose, sigma_i, sigma_j)
    latent: Array = carried.T @ weight @ residual
    latent[:, 6:] += _IDENTITY
    changes = adjoint_derivative(pose)
    weighted = (weight @ changes).reshape(6, 36)
    moved = second @ latent.T

    def information(twist_moment: Array) -> Array:
        result: Array = weighted @ (changes @ twist_moment).reshape(6, 36).T
        return result

    score = weighted @ (residual @ moved).ravel()
    latent_noise = count * (latent * np.concatenate([sigma_i, sigma_j])) @ latent.T
    return score, information(latent @ moved), information(latent_noise)


def _weighted_residual(pose: Pose, sigma_i: Array, sigma_j: Array) -> tuple[Array, Array, Array]:
    """``Ad`` times the variances of ``xi_j`` (6, 6), ``[1, -Ad]`` (6, 12), and the weight of these residuals (6, 6)."""
    adjoint = pose.adjoint()
    carried = adjoint * sigma_j
    covariance = carried @ adjoint.T
    covariance[_DIAGONAL, _DIAGONAL] += sigma_i
    residual: Array = np.empty((6, 12))
    residual[:, :6], residual[:, 6:] = _IDENTITY, -adjoint
    return carried, residual, np.asarray(np.linalg.inv(covariance), dtype=np.float64)


@lru_cache(maxsize=_POSES)
def adjoint_derivative(pose: Pose) -> Array:
    """Derivatives of ``pose.adjoint()`` by its perturbation, shape (6, 6, 6), the perturbation first; read only."""
    turned = CROSS_OF_AXES @ pose.rotation
    derivative = np.zeros((6, 6, 6))
    derivative[:3, :3, :3] = derivative[:3, 3:, 3:] = derivative[3:, 3:, :3] = turned
    derivative[:3, 3:, :3] = skew(pose.translation) @ turned
    derivative.flags.writeable = False
    return derivative


def _vee(antisymmetric: Array) -> Array:
    """``x`` with ``skew(x) == antisymmetric``."""
    return np.array([antisymmetric[2, 1], antisymmetric[0, 2], antisymmetric[1, 0]])

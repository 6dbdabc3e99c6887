"""Poses of a whole team at the joint optimum, from what single robots know of themselves.

Every robot keeps ``RegistrationMoments``: its own samples against the body's motion that the network found. From time
to time all robots tell their score at the poses in use, 6 numbers each. As all of them see the same body motion, any of
them can then compute the **joint** information of all poses, with every sample's body motion eliminated, take the joint
Gauss-Newton step, and state the covariance of any relative pose.

The samples had been summed with the poses of their time. ``refit_map`` is what the new poses would have made of them:
a constant linear map of the moments' features, so nothing is summed again, and the recursion keeps to the
maximum-likelihood estimate of all samples so far.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from coheft.estimation.body_motion import perturbation_between, perturbed, relative_pose_derivative
from coheft.estimation.measurement import SensorNoise, kinematic_weights
from coheft.estimation.observability import (
    AllSeen,
    PoseEstimate,
    SeenInformation,
    Visibility,
    all_seen,
    doubt_of,
    seen_information,
)
from coheft.estimation.registration import ACCELERATION, FEATURES, PRODUCTS, TWIST, RegistrationMoments
from coheft.estimation.rigid_body import packed_rotation
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.team_sensing import channels

NO_SLOPE: Array = np.zeros((6, 6))
"""What the gyros' slope says of motions that were found without it."""
NO_SLOPE.flags.writeable = False
_UNSEEN = 1e-3
"""Directions of which samples say so little, compared with what was known before, cannot contradict it."""
_SIGMAS = 6.0
"""By so many standard deviations of a chi-square samples may contradict what was known before."""
_MANY = 64
"""Of more poses nobody looks for directions that were not seen unless there may be some: that takes long."""


@dataclass(frozen=True, eq=False)
class TeamPoses:
    """Poses of all robots and how well they are known.

    Attributes:
        poses: In the body frame; the first, the reference robot's, defines it.
        covariance: Of all perturbations, shape (6 N, 6 N); zero for the first.
        limits: When a direction counts as seen.
    """

    poses: tuple[Pose, ...]
    covariance: Array
    limits: Visibility

    @staticmethod
    def known_within(poses: Sequence[Pose], deviations: Array, limits: Visibility | None = None) -> TeamPoses:
        """Poses whose errors, as far as is known, are independent and have these standard deviations, shape (N, 6)."""
        return TeamPoses(tuple(poses), np.diag(np.square(deviations).ravel()), limits or Visibility())

    @property
    def deviations(self) -> Array:
        """Standard deviations of all perturbations, shape (N, 6)."""
        result: Array = np.sqrt(self.covariance.diagonal()).reshape(-1, 6)
        return result

    @property
    def bounds(self) -> Array:
        """Deviations of independent errors that are as large as these, or larger, in every direction, shape (N, 6)."""
        deviations = self.deviations
        scale = np.where(deviations > 0.0, deviations, 1.0).ravel()
        largest = np.linalg.eigvalsh(self.covariance / scale[:, None] / scale)[-1]
        bounds: Array = np.sqrt(max(float(largest), 1.0)) * deviations
        return bounds

    def relative(self, i: int, j: int) -> PoseEstimate:
        """``pose_j_in_i`` of two different robots."""
        derivative = relative_pose_derivative(self.poses[i], self.poses[j])
        by_robot = self.covariance.reshape(len(self.poses), 6, len(self.poses), 6)
        covariance = derivative @ by_robot[[i, j]][:, :, [i, j]].reshape(12, 12) @ derivative.T
        seen = seen_information(np.linalg.inv(covariance).astype(np.float64), self.limits)
        return PoseEstimate(self.poses[i].inverse() @ self.poses[j], covariance, seen.unseen())


@dataclass(frozen=True, eq=False)
class PosePrior:
    """What is known of all poses from before the samples that they are fitted to.

    Attributes:
        poses: In the body frame.
        information: Of independent errors of all but the first, shape (N - 1, 6).
    """

    poses: tuple[Pose, ...]
    information: Array

    @staticmethod
    def of(team: TeamPoses) -> PosePrior:
        """Poses that are known within their deviations, none of them zero, and the first one exactly."""
        return PosePrior(team.poses, team.deviations[1:] ** -2)

    def score(self, poses: Sequence[Pose]) -> Array:
        """Derivative of the log-likelihood by the perturbations of other poses, shape (N - 1, 6)."""
        pairs = zip(poses[1:], self.poses[1:], strict=True)
        score: Array = self.information * np.array([perturbation_between(pose, known) for pose, known in pairs])
        return score

    def scaled(self, factor: float) -> PosePrior:
        """The same with so many times the information."""
        return PosePrior(self.poses, factor * self.information)

    def fits(
        self,
        poses: Sequence[Pose],
        scores: Array,
        moments: RegistrationMoments,
        noise: SensorNoise,
        slope: Array,
        inflation: float,
    ) -> bool:
        """Whether samples say the same, within what both are uncertain; arguments as of ``register_team``.

        The scores at the poses that were known before have the covariance ``I + I P^-1 I``, with the information ``I``
        of the samples divided by ``inflation``, and ``P`` of what was known.
        """
        deviations = self.information.ravel() ** -0.5
        samples = team_information(moments, poses, noise, slope)[0][6:, 6:] / inflation
        information = samples * np.outer(deviations, deviations)
        score = deviations * scores[1:].ravel() / inflation - information @ (deviations * self.score(poses).ravel())
        values, vectors = np.linalg.eigh(information)
        score = vectors.T @ score
        seen = values > _UNSEEN
        square = float(np.sum(score[seen] ** 2 / (values + values**2)[seen]))
        degrees = float(seen.sum())
        return square <= degrees + _SIGMAS * float(np.sqrt(2.0 * degrees))


def seen_from(team: TeamPoses, own: str, names: Sequence[str], others: Iterable[str]) -> dict[str, PoseEstimate]:
    """Poses of other robots in the frame of one, by name; ``names`` are those of the team in its order."""
    return {other: team.relative(names.index(own), names.index(other)) for other in sorted(others)}


def register_team(
    poses: Sequence[Pose],
    scores: Array,
    moments: RegistrationMoments,
    noise: SensorNoise,
    limits: Visibility | None = None,
    slope: Array = NO_SLOPE,
    prior: PosePrior | None = None,
) -> TeamPoses:
    """One joint Gauss-Newton step.

    Args:
        poses: Of all robots in the body frame; the first stays as it is.
        scores: Of all robots at these poses, from ``score_and_information``, shape (N, 6).
        moments: Of any one robot: only what they say of the body's motion is used, and is the same for all.
        noise: Of every robot's sensors.
        limits: When a direction counts as seen.
        slope: What the gyros' slope says about ``(a, alpha)``, shape (6, 6), if the body's motion was found with it.
        prior: What is known of the poses from before.
    """
    limits = limits or Visibility()
    seen = _seen(poses, moments, noise, limits, slope, prior)
    score = scores[1:] if prior is None else scores[1:] + prior.score(poses)
    steps = seen.step(score.ravel()).reshape(-1, 6)
    moved = (perturbed(pose, step) for pose, step in zip(poses[1:], steps, strict=True))
    return _team_poses((poses[0], *moved), seen, limits)


def fitted_poses(
    poses: Sequence[Pose],
    moments: RegistrationMoments,
    noise: SensorNoise,
    limits: Visibility | None = None,
    slope: Array = NO_SLOPE,
    prior: PosePrior | None = None,
) -> TeamPoses:
    """How well poses are known that were fitted to samples with these moments; arguments as of ``register_team``."""
    limits = limits or Visibility()
    return _team_poses(tuple(poses), _seen(poses, moments, noise, limits, slope, prior), limits)


def _seen(
    poses: Sequence[Pose],
    moments: RegistrationMoments,
    noise: SensorNoise,
    limits: Visibility,
    slope: Array,
    prior: PosePrior | None,
) -> SeenInformation | AllSeen:
    """Joint information of all poses but the first's, as far as it is due to motion, or known from before."""
    information, from_noise = team_information(moments, poses, noise, slope)
    doubt = doubt_of(from_noise, moments.count)
    known, doubt = (information - from_noise)[6:, 6:], doubt[6:, 6:]
    if prior is not None:
        known = known + np.diag(prior.information.ravel())
    seen = all_seen(known, limits, doubt) if len(poses) > _MANY else None
    return seen or seen_information(known, limits, doubt)


def _team_poses(poses: tuple[Pose, ...], seen: SeenInformation | AllSeen, limits: Visibility) -> TeamPoses:
    covariance = np.zeros((6 * len(poses), 6 * len(poses)))
    covariance[6:, 6:] = seen.inverse()
    return TeamPoses(poses, covariance, limits)


def team_information(
    moments: RegistrationMoments, poses: Sequence[Pose], noise: SensorNoise, slope: Array = NO_SLOPE
) -> tuple[Array, Array]:
    """Joint information of all poses, the motions of all samples eliminated, and what of it is due to noise.

    With ``D_i`` the derivative of robot i's predicted measurements, linear in the features ``x``, and ``B_i`` that by
    the motion: ``H_ij = sum over samples of  delta_ij D_i^T W D_i - (D_i^T W B_i) P (B_j^T W D_j)`` with
    ``P = (sum_i B_i^T W B_i + S)^-1``, where ``S`` is what the gyros' slope says about the motion, and ``D_i`` enters
    only with the features' moments. That ``w`` in centripetal accelerations is noisy is left out: 2 % of the standard
    deviation in the worst direction of a usual team.

    Returns:
        Two matrices, shape (6 N, 6 N). The motion's own noise makes the first too large by the second.
    """
    count, size = len(poses), 6 * len(poses)
    information, from_noise = np.zeros((size, size)), np.zeros((size, size))
    grams, priors = (moments.centred(), moments.gram), (NO_SLOPE, slope)
    for channel, gram, prior in zip(channels(poses, noise), grams, priors, strict=True):
        covariance = channel.covariance(prior)
        noise_gram = moments.count * covariance @ (channel.information + prior) @ covariance
        explained = (covariance @ channel.coupling.reshape(6, -1)).reshape(6, size, -1)
        weighted = channel.weights[:, None] * channel.by_pose
        # The noise's moments are those of the motion alone.
        everything = slice(None)
        for total, features, columns in ((information, gram, everything), (from_noise, noise_gram, channel.columns)):
            total -= _contracted(explained[..., columns] @ features, channel.coupling[..., columns])
            own, other = (each[..., columns].reshape(size, -1, len(features)) for each in (weighted, channel.by_pose))
            own = (own @ features).reshape(count, 6, -1) @ other.reshape(count, 6, -1).swapaxes(1, 2)
            total.reshape(count, 6, count, 6)[range(count), :, range(count)] += own
    return information, from_noise


def _contracted(first: Array, second: Array) -> Array:
    """Sum over the first and last dimensions of arrays (m, k, n): shape (k, k)."""
    first, second = (each.swapaxes(0, 1).reshape(each.shape[1], -1) for each in (first, second))
    result: Array = first @ second.T
    return result


def motion_by_poses(poses: Sequence[Pose], noise: SensorNoise, slope: Array = NO_SLOPE) -> Array:
    """How the fused ``(a, alpha)`` of a sample follows, linear in its features, when poses are perturbed.

    The derivative of ``refit_map`` by the new poses, rows ``ACCELERATION``, but for what turning ``w`` does to its
    products: up to 1 % of what poses do to the inertia.

    Returns:
        Shape (6, 6 N, 28), the motion first, then the perturbations of all poses.
    """
    _, accelerations = channels(poses, noise)
    found = -accelerations.covariance(slope) @ accelerations.coupling.reshape(6, -1)
    return found.reshape(accelerations.coupling.shape)


def residual_shares(poses: Sequence[Pose], noise: SensorNoise) -> Array:
    """Share of the square of each robot's noise that is left in its residuals to the motion in the sums, shape (N,).

    The rest is in that motion as well: ``1 - tr(P B_i^T W B_i) / 9``, with names as in ``team_information``.
    """
    shares = np.ones(len(poses))
    for channel in channels(poses, noise):
        by_motion = channel.predicted[:, :, channel.columns]
        found = channel.weights[:, None] * (by_motion @ channel.covariance(NO_SLOPE))
        shares -= (found * by_motion).sum(axis=(1, 2)) / len(kinematic_weights(noise))
    return shares


def refit_map(old: Sequence[Pose], new: Sequence[Pose], noise: SensorNoise, slope: Array = NO_SLOPE) -> Array:
    """Features of a sample had its body motion been found with the poses ``new`` instead of ``old``, shape (28, 28).

    The motion found with ``old`` predicts what all robots measured; the map fits the motion to that with ``new``.
    What it neglects is the change of poses times the residuals. In the products of ``w``, the (small) share of the
    velocities in ``w`` is left as it was. What the gyros' slope says of the motion does not depend on the poses.
    """
    feature_map = np.eye(FEATURES)
    (old_twists, old_accelerations), (twists, accelerations) = (channels(poses, noise) for poses in (old, new))
    feature_map[TWIST] = twists.find(old_twists.predicted, NO_SLOPE)
    turn = feature_map[TWIST.start : TWIST.start + 3, TWIST.start : TWIST.start + 3]
    feature_map[PRODUCTS, PRODUCTS] = packed_rotation(turn)
    rest = old_accelerations.predicted.copy()
    rest[:, :, PRODUCTS] -= accelerations.predicted[:, :, PRODUCTS] @ feature_map[PRODUCTS, PRODUCTS]
    feature_map[ACCELERATION] = accelerations.find(rest, slope)
    return feature_map

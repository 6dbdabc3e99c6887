"""The reference that no team of robots can have: all sensors' samples of a whole run in one place, solved as a batch.

Poses: joint Gauss-Newton steps at the maximum of the likelihood, with the body's motion summed anew from all samples
after every step. Inertia: all samples, summed with the final poses. No graph, no delays, no moments of old poses, and
the same noise models as on the robots, so the ratio of errors says what being decentralised and recursive costs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from coheft.estimation.body_motion import perturbation_between
from coheft.estimation.inertia import InertiaModel, features, packed_gram, unpacked_gram
from coheft.estimation.inertia_estimate import InertiaEstimate, middle_and_size, solve_inertia, unseen_quantities
from coheft.estimation.measurement import KINEMATICS, SAMPLE_SIZE, TWIST, WRENCH, SensorNoise
from coheft.estimation.motion_fusion import (
    MotionFusion,
    derivative,
    slope_kernel,
    summands,
)
from coheft.estimation.pose_sensitivity import MOTION_FEATURES, PoseSensitivity, inertia_by_poses
from coheft.estimation.registration import RegistrationMoments, score_and_information
from coheft.estimation.rigid_body import Inertia
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.team_registration import TeamPoses, register_team
from coheft.estimation.twist_registration import TwistMoments, register_twists

_POSE_STEPS = 30
_CLOSE = 1e-3
"""Steps of poses below this share of their standard deviations are the last."""
_REWEIGHTINGS = 3


@dataclass(frozen=True, eq=False)
class CentralisedEstimate:
    """What a central computer would have found.

    Attributes:
        team: Poses of all robots in the body frame, which is the first robot's.
        payload: Its mass properties in the body frame, given the poses; only ``unseen`` counts in what the poses add.
        covariance: Of ``(m, h, J)``, ``J`` packed, with what the poses add, shape (10, 10).
        rows: Samples that the inertia is from: of ``BodySums``.
        residual: What body and offset leave of the total wrench of these samples, shape (rows, 6).
        expected: Covariance of the residual that the sensors' noise explains, shape (6, 6).
        is_settled: Whether steps of poses had become small when no more were taken.
    """

    team: TeamPoses
    payload: InertiaEstimate
    covariance: Array
    rows: slice
    residual: Array
    expected: Array
    is_settled: bool

    @property
    def poses(self) -> tuple[Pose, ...]:
        """Of all robots in the body frame."""
        return self.team.poses

    @property
    def inertia(self) -> Inertia:
        """Of the payload in the body frame."""
        return self.payload.inertia


@dataclass(frozen=True, eq=False)
class BodySums:
    """The body's motion and what moves it, from all robots' sensors carried to the body frame with some poses.

    Attributes:
        motion: ``(w, v, a, alpha)``, shape (n, 12).
        wrench: Total, shape (n, 6).
        fusion: Says how certain both are.
        rows: Samples whose motion is right: where gyros' slopes are needed, not the first and last 20 ms.
    """

    motion: Array
    wrench: Array
    fusion: MotionFusion
    rows: slice


def sum_up(samples: Array, poses: Sequence[Pose], noise: SensorNoise, rate: float) -> BodySums:
    """Sum all samples up, in the body frame.

    Args:
        samples: Of all robots, consecutive, shape (n, N, 15), columns as in ``MeasurementBlock``.
        poses: Of all robots in the body frame.
        noise: Of every robot's sensors.
        rate: Samples per second.

    Raises:
        ValueError: Shapes do not fit.
    """
    if samples.shape[1:] != (len(poses), SAMPLE_SIZE):
        raise ValueError(f"{samples.shape=} but expected (n, {len(poses)}, {SAMPLE_SIZE})")
    sums = np.sum([summands(samples[:, i], noise) @ pose.adjoint().T for i, pose in enumerate(poses)], axis=0)
    kernel = slope_kernel(rate, len(samples))
    half_span = len(kernel) // 2
    fusion = MotionFusion.of_robots(noise, poses, kernel)
    slope, rows = None, slice(len(samples))
    if fusion.derivative_gain is not None:
        # There is no slope where nobody measured what was before or after; of less than 80 ms all are better than none.
        w = np.pad(fusion.angular_velocity(sums), ((half_span, half_span), (0, 0)), mode="edge")
        slope = derivative(w, kernel)
        lost = min(half_span, len(samples) // 4)
        rows = slice(lost, len(samples) - lost)
    return BodySums(fusion.motion(sums, slope), sums[:, 0], fusion, rows)


def estimate_centralised(
    samples: Array, noise: SensorNoise, rate: float, with_offset: bool = False
) -> CentralisedEstimate:
    """Poses and inertia from all samples of all robots, taken while the load was the same.

    Args:
        samples: Consecutive, shape (n, N, 15), columns as in ``MeasurementBlock``.
        noise: Of every robot's sensors.
        rate: Samples per second.
        with_offset: Whether force and torque sensors may have constant offsets.

    Raises:
        ValueError: Shapes do not fit.
        numpy.linalg.LinAlgError: Numbers are too large or too small to be computed with.
    """
    team, is_settled = _estimate_poses(samples, noise, rate)
    poses = team.poses
    sums = sum_up(samples, poses, noise, rate)
    used = features(sums.motion[sums.rows], sums.wrench[sums.rows])
    gram = packed_gram(used)
    middle, size = middle_and_size(poses)
    parameters = None
    for _ in range(_REWEIGHTINGS):
        model = InertiaModel(
            sums.fusion.wrench_covariance, sums.fusion.acceleration_covariance, parameters, with_offset
        )
        information = model.information(gram)
        solution = solve_inertia(information, middle, size)
        parameters = solution.parameters
    by_poses = inertia_by_poses(
        model,
        information,
        solution.parameters,
        unpacked_gram(gram),
        np.einsum("kf,kiw->ifw", used[:, MOTION_FEATURES], samples[sums.rows, :, WRENCH]),
        PoseSensitivity.of(poses, noise, sums.fusion.slope_information),
    )
    doubt = by_poses @ team.covariance @ by_poses.T
    estimate = solution.made_possible(doubt)
    unknowns = np.concatenate([estimate.parameters, [] if estimate.offset is None else estimate.offset])
    explained = np.tensordot(used, model.regressor_coefficients, axes=1) @ unknowns
    covariance = estimate.to_central @ (solution.covariance + doubt) @ estimate.to_central.T
    return CentralisedEstimate(
        team=team,
        payload=replace(estimate, unseen=unseen_quantities(covariance, estimate.inertia.mass, size)),
        covariance=covariance,
        rows=sums.rows,
        residual=sums.wrench[sums.rows] - explained,
        expected=model.residual_covariance,
        is_settled=is_settled,
    )


def _estimate_poses(samples: Array, noise: SensorNoise, rate: float) -> tuple[TeamPoses, bool]:
    """Poses of all robots in the first one's frame, from their twists at first, then from all kinematics jointly.

    Returns:
        They, and whether the last step was small.
    """
    first = samples[:, 0, TWIST]
    count = samples.shape[1]
    pairs = (TwistMoments.of(first, samples[:, i, TWIST]) for i in range(1, count))
    poses = (Pose.identity(), *(register_twists(pair, noise, noise).pose for pair in pairs))
    for _ in range(_POSE_STEPS):
        sums = sum_up(samples, poses, noise, rate)
        right = samples[sums.rows]
        moments = [RegistrationMoments.of(right[:, i, KINEMATICS], sums.motion[sums.rows]) for i in range(count)]
        scores = [score_and_information(own, pose, noise)[0] for own, pose in zip(moments, poses, strict=True)]
        team = register_team(poses, np.array(scores), moments[0], noise, slope=sums.fusion.slope_information)
        steps = [perturbation_between(old, new) for old, new in zip(poses, team.poses, strict=True)]
        poses = team.poses
        deviations = np.sqrt(np.diag(team.covariance))[6:]
        if np.all(np.abs(np.concatenate(steps)[6:]) < _CLOSE * deviations):
            return team, True
    return team, False

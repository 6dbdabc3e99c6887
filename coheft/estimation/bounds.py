"""The joint Cramér-Rao bound of all poses and of the load's inertia, for any unbiased estimator.

Model. The unknowns are the poses of all robots but the first, the ten inertial parameters, and for every sample the
motion of the body (12 numbers) and the true wrench of every robot (6 numbers each). Every robot's gyro, velocity,
accelerometer, force and torque are measured with white noise. Physics constrains the true wrenches: transformed to the
body frame with the poses, their sum satisfies the Newton-Euler equations. Eliminating the individual wrenches leaves
one measurement per sample of ``sum_i Ad(g_i) u_i - W(motion, inertia) = 0`` with covariance ``sum_i Ad(g_i) Sigma
Ad(g_i)^T`` (noise with lever arms). It **does depend on the poses**, through the transformed wrenches: a wrong pose
gives a wrong total. Conversely, wrenches contain information about poses, the more the harder the robots push against
each other: the **full** bound. Estimators that determine poses from kinematics alone, and transform wrenches with
these, do not use that information: theirs is the **two-step** bound. The body motion is eliminated by a Schur
complement per sample.

Constant sensor errors with a tolerance (``SensorTolerance``) are unknown as well, with the tolerances as priors.

The bound does not use that consecutive samples belong to one smooth motion (the gyro's change contains information
about alpha, the velocity's about a), so it applies to estimators that do not use it either.

All derivatives are computed here sample by sample, independently of the estimators' features, so that each can check
the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from coheft.estimation.geometry.body_motion import (
    BODY_A,
    BODY_ALPHA,
    BODY_W,
    MOTION_SIZE,
    centripetal_derivative,
    grasp_derivatives,
    relative_pose_derivative,
)
from coheft.estimation.geometry.spatial import Array, Pose, skew
from coheft.estimation.measurement import KINEMATICS, WRENCH, SensorNoise
from coheft.estimation.rigid_body.derivatives import barycentric_derivative, seen_inertia_derivative
from coheft.estimation.rigid_body.mass_properties import Inertia, inertia_operator, unpack_symmetric
from coheft.estimation.rigid_body.regressor import INERTIA_SIZE
from coheft.estimation.sensor_effects import Readings, SensorError, sensor_errors
from coheft.estimation.tolerance import SensorTolerance

_CHUNK = 256
_NEGLIGIBLE = 1e-6
"""Information that is added to each body motion, in SI units: negligible, but two robots alone do not observe all of
alpha."""
_UNOBSERVABLE = 1e-13
"""Eigenvalues of the scaled information below this share of the largest are due to rounding."""


@dataclass(frozen=True, eq=False)
class JointBound:
    """Smallest covariance that an unbiased estimator can have; huge (not infinite) where nothing is observable.

    Attributes:
        poses: Poses of the N robots in the body frame.
        inertia: Inertia of the body, in the body frame.
        covariance: Covariance of the stacked errors, shape (6 N + 10, 6 N + 10): each pose's perturbation (zero for the
            first, which defines the body frame), then ``(m, h, J)`` with ``J`` about the centre of mass, packed.
    """

    poses: tuple[Pose, ...]
    inertia: Inertia
    covariance: Array

    def relative_pose(self, i: int, j: int) -> Array:
        """Return the covariance (6, 6) of ``pose_j_in_i``: rotation vector [rad], translation [m], in the axes of
        ``F_i``.
        """
        derivative = relative_pose_derivative(self.poses[i], self.poses[j])
        rows = np.r_[6 * i : 6 * i + 6, 6 * j : 6 * j + 6]
        result: Array = derivative @ self.covariance[np.ix_(rows, rows)] @ derivative.T
        return result

    def inertia_seen_from(self, i: int) -> Array:
        """Return the covariance (10, 10) of ``(m, h_i, J_i)`` [kg, m, kg·m²], ``J_i`` packed, in the frame of robot
        i.
        """
        derivative = seen_inertia_derivative(self.poses[i], self.inertia)
        rows = np.r_[6 * i : 6 * i + 6, 6 * len(self.poses) : len(self.covariance)]
        result: Array = derivative @ self.covariance[np.ix_(rows, rows)] @ derivative.T
        return result


@dataclass(frozen=True, eq=False)
class JointInformation:
    """Fisher information of samples on all poses and the load; information of several parts of a run can be added.

    The unknowns are the poses, q sensor errors (of kinematics first, then of wrenches), and the inertia.

    Attributes:
        poses: Poses of the N robots in the body frame.
        inertia: Inertia of the body, in the body frame.
        all_sensors: Fisher information of the unknowns, shape (6 N + q + 10, 6 N + q + 10).
        kinematics: Fisher information from gyros, velocities and accelerometers alone, of the same shape.
        errors: Standard deviations of the sensor errors, shape (q,).
        of_wrenches: Number of errors that concern wrenches.
    """

    poses: tuple[Pose, ...]
    inertia: Inertia
    all_sensors: Array
    kinematics: Array
    errors: Array
    of_wrenches: int

    @staticmethod
    def of(
        poses_in_reference: Sequence[Pose],
        inertia_in_reference: Inertia,
        motion: Array,
        wrenches: Array,
        noise: SensorNoise | Sequence[SensorNoise],
        tolerance: SensorTolerance | Sequence[SensorTolerance] = (),
        rates: tuple[Array, Array, Array] | None = None,
    ) -> JointInformation:
        """Compute the information of samples, at the true parameters.

        Args:
            poses_in_reference: Pose of every ``F_i`` in the body frame; the first is taken as known, usually identity.
            inertia_in_reference: Inertia of the body, in the body frame.
            motion: True body motion ``(w, v, a, alpha)``, shape (n, 12).
            wrenches: True wrench of every robot, each in its own frame, shape (n, N, 6).
            noise: Noise of every robot's sensors, or of each robot's.
            tolerance: Tolerances of every robot's sensors, or of each robot's; none if they have no constant errors.
            rates: Rates of motion and wrenches, of the same shapes, and first and second derivatives of forces in axes
                that do not rotate, shape (n, N, 6); required if clocks or wrenches may be late, or grasps compliant.

        Raises:
            ValueError: Shapes do not match, or rates are required and missing.
        """
        poses = tuple(poses_in_reference)
        if motion.shape[1:] != (MOTION_SIZE,) or wrenches.shape != (len(motion), len(poses), 6):
            raise ValueError(f"{motion.shape=} and {wrenches.shape=} but expected (n, 12) and (n, {len(poses)}, 6)")
        noises = [noise] * len(poses) if isinstance(noise, SensorNoise) else noise
        tolerances = [tolerance] * len(poses) if isinstance(tolerance, SensorTolerance) else tolerance
        if rates is None:
            if any(each.clock or each.wrench_delay or each.grasp_compliance for each in tolerances):
                raise ValueError(
                    "the effects of delays and compliance depend on how fast motion and wrenches change: expected "
                    "rates, found None"
                )
            rates = np.zeros_like(motion), np.zeros_like(wrenches), np.zeros_like(wrenches)
        errors = sensor_errors(tolerances)
        all_sensors, kinematics = np.zeros((2, *(6 * len(poses) + len(errors) + INERTIA_SIZE,) * 2))
        for start in range(0, len(motion), _CHUNK):
            rows = slice(start, start + _CHUNK)
            readings = [
                Readings.at(
                    pose,
                    *(each[rows] for each in (motion, wrenches[:, i], rates[0], rates[1][:, i], rates[2][:, i])),
                )
                for i, pose in enumerate(poses)
            ]
            chunk = _information_of_chunk(poses, inertia_in_reference, motion[rows], readings, noises, errors)
            all_sensors += chunk[0]
            kinematics += chunk[1]
        deviations = np.array([error.deviation for error in errors])
        of_wrenches = sum(error.is_of_wrench for error in errors)
        return JointInformation(poses, inertia_in_reference, all_sensors, kinematics, deviations, of_wrenches)

    def __add__(self, other: JointInformation) -> JointInformation:
        return replace(
            self,
            all_sensors=self.all_sensors + other.all_sensors,
            kinematics=self.kinematics + other.kinematics,
        )

    def with_another_load(self) -> JointInformation:
        """Return the information on poses that remains when the load is replaced by an unknown one."""
        f, g = slice(-INERTIA_SIZE, None), slice(0, -INERTIA_SIZE)
        of_poses, by_load = np.zeros_like(self.all_sensors), self.all_sensors[g, f]
        of_poses[g, g] = self.all_sensors[g, g] - by_load @ _inverse(self.all_sensors[f, f]) @ by_load.T
        return replace(self, all_sensors=of_poses)

    def full_bound(self) -> JointBound:
        """Return the joint bound of poses and inertia from all sensors."""
        return self._bound(_inverse(self._with_prior(self.all_sensors)[6:, 6:]))

    def two_step_bound(self) -> JointBound:
        """Return the bound of poses from all kinematics, ``cov_g``, then the inertia from all sensors given those
        poses.

        Errors of kinematics are estimated with the poses, those of wrenches with the inertia.

        The result is ``I_ff^-1 + I_ff^-1 I_fg cov_g I_gf I_ff^-1`` with the blocks of the joint information: the errors
        of the two steps are independent, because the score of the second is orthogonal to the residuals of the first.
        """
        information = self._with_prior(self.all_sensors)[6:, 6:]
        second = INERTIA_SIZE + self.of_wrenches
        f, g = slice(-second, None), slice(0, -second)
        pose_covariance = _inverse(self._with_prior(self.kinematics)[6:, 6:][g, g])
        given_poses = _inverse(information[f, f])
        by_poses = -given_poses @ information[f, g]
        stacked = np.vstack([np.eye(len(pose_covariance)), by_poses])
        covariance = stacked @ pose_covariance @ stacked.T
        covariance[f, f] += given_poses
        return self._bound(covariance)

    def _with_prior(self, information: Array) -> Array:
        """Return the information including the priors of the sensor errors."""
        first = 6 * len(self.poses)
        places = np.arange(first, first + len(self.errors))
        result = information.copy()
        result[places, places] += self.errors**-2.0
        return result

    def _bound(self, covariance: Array) -> JointBound:
        """Return the bound of poses and inertia for a covariance of all unknowns but the first pose."""
        size, poses = 6 * len(self.poses) + INERTIA_SIZE, 6 * len(self.poses) - 6
        asked = np.r_[:poses, len(covariance) - INERTIA_SIZE : len(covariance)]
        result = np.zeros((size, size))
        result[6:, 6:] = covariance[np.ix_(asked, asked)]
        return JointBound(self.poses, self.inertia, result)


def _information_of_chunk(
    poses: tuple[Pose, ...],
    inertia: Inertia,
    motion: Array,
    readings: Sequence[Readings],
    noises: Sequence[SensorNoise],
    errors: Sequence[SensorError],
) -> tuple[Array, Array]:
    """Return the information of a few samples from all sensors, and from kinematics alone, with all whitened
    Jacobians.
    """
    n, count = len(motion), len(poses)
    size = 6 * count + len(errors) + INERTIA_SIZE
    deviations = [noise.per_column() for noise in noises]
    by_parameters = np.zeros((n, 9 * count + 6, size))
    by_motion = np.empty((n, 9 * count + 6, MOTION_SIZE))
    total_covariance = np.zeros((6, 6))
    for i, pose in enumerate(poses):
        rows, columns = slice(9 * i, 9 * i + 9), slice(6 * i, 6 * i + 6)
        pose_part, motion_part = grasp_derivatives(pose, motion)
        deviation = deviations[i]
        by_parameters[:, rows, columns] = pose_part / deviation[KINEMATICS, None]
        by_motion[:, rows] = motion_part / deviation[KINEMATICS, None]
        by_parameters[:, -6:, columns] = -carried_wrench_derivative(pose, readings[i].exact[:, WRENCH])
        scaled_adjoint = pose.adjoint() * deviation[WRENCH]
        total_covariance += scaled_adjoint @ scaled_adjoint.T
    for column, error in enumerate(errors, start=6 * count):
        effect, own = error.effect(readings[error.robot]), slice(9 * error.robot, 9 * error.robot + 9)
        by_parameters[:, own, column] = effect[:, KINEMATICS] / deviations[error.robot][KINEMATICS]
        by_parameters[:, -6:, column] = -effect[:, WRENCH] @ poses[error.robot].adjoint().T
    by_parameters[:, -6:, -INERTIA_SIZE:] = wrench_regressor(motion) @ barycentric_derivative(inertia)
    by_motion[:, -6:] = wrench_derivative(inertia, motion)
    whitening = np.linalg.inv(np.linalg.cholesky(total_covariance))
    for jacobian in (by_parameters, by_motion):
        jacobian[:, -6:] = whitening @ jacobian[:, -6:]
    return _reduced(by_parameters, by_motion), _reduced(by_parameters[:, :-6], by_motion[:, :-6])


def _reduced(by_parameters: Array, by_motion: Array) -> Array:
    """Return the information of the parameters after eliminating every sample's motion."""
    size = by_parameters.shape[2]
    flat = by_parameters.reshape(-1, size)
    coupling = by_motion.transpose(0, 2, 1) @ by_parameters
    nuisance = by_motion.transpose(0, 2, 1) @ by_motion + _NEGLIGIBLE * np.eye(MOTION_SIZE)
    explained = np.linalg.solve(nuisance, coupling).reshape(-1, size)
    return flat.T @ flat - coupling.reshape(-1, size).T @ explained


def _inverse(information: Array) -> Array:
    """Return the inverse; huge where the information is only due to rounding."""
    diagonal = np.diag(information)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    values, vectors = np.linalg.eigh(scale[:, None] * information * scale)
    values = np.maximum(values, _UNOBSERVABLE * max(values[-1], 1.0))
    scaled = scale[:, None] * vectors
    result: Array = (scaled / values) @ scaled.T
    return result


def wrench_regressor(motion: Array) -> Array:
    """Return ``Y`` with total wrench ``W = Y(motion) (m, m h, I_o)``, for body motions (n, 12): shape (n, 6, 10)."""
    w, a, alpha = motion[:, BODY_W], motion[:, BODY_A], motion[:, BODY_ALPHA]
    spin = skew(w)
    regressor = np.zeros((len(motion), 6, INERTIA_SIZE))
    regressor[:, :3, 0] = a
    regressor[:, :3, 1:4] = skew(alpha) + spin @ spin
    regressor[:, 3:, 1:4] = -skew(a)
    regressor[:, 3:, 4:] = inertia_operator(alpha) + spin @ inertia_operator(w)
    return regressor


def wrench_derivative(inertia: Inertia, motion: Array) -> Array:
    """Return the derivative of the total wrench ``inertia.wrench(w, a, alpha)`` by the body motion, shape (n, 6,
    12).
    """
    w = motion[:, BODY_W]
    moment = inertia.mass * inertia.com
    about_origin = unpack_symmetric(inertia.barycentric()[4:])
    derivative = np.zeros((len(motion), 6, MOTION_SIZE))
    derivative[:, :3, BODY_W] = centripetal_derivative(w, moment)
    derivative[:, :3, BODY_A] = inertia.mass * np.eye(3)
    derivative[:, :3, BODY_ALPHA] = -skew(moment)
    derivative[:, 3:, BODY_W] = skew(w) @ about_origin - skew(w @ about_origin)
    derivative[:, 3:, BODY_A] = skew(moment)
    derivative[:, 3:, BODY_ALPHA] = about_origin
    return derivative


def carried_wrench_derivative(pose_i: Pose, wrenches: Array) -> Array:
    """Return the derivative of ``Ad(pose_i) (f, t)`` by the pose's perturbation, for (n, 6) in ``F_i``: (n, 6, 6)."""
    force = skew(wrenches[:, :3] @ pose_i.rotation.T)
    derivative = np.zeros((len(wrenches), 6, 6))
    derivative[:, :3, :3] = derivative[:, 3:, 3:] = -force
    derivative[:, 3:, :3] = -skew(wrenches[:, 3:] @ pose_i.rotation.T) - skew(pose_i.translation) @ force
    return derivative

"""Matrices at one state that take rows of the whole team to the body's motion and to the total wrench.

    psi = motion_map @ x                      motion (1, w, v, a, alpha, products of w), least squares over all robots
    (w, v, a, slope)_i = predict_i @ psi + noise
    total wrench = sum_i Ad(g_i) (f, t)_i = wrench_map @ x

``x = (z, z')``: the rows of all robots one after another, then 1; and, only if some sensor may be late, the rates of
these numbers. ``psi`` then has the rates of its 19 numbers as well. If grasps are compliant, each robot's ``z'`` and
``psi`` also contain the measured rates of its force (``flexing``). Everything else is in the body frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coheft.estimation.geometry.spatial import CROSS_OF_AXES, Array, skew
from coheft.estimation.linear_algebra import inverse as inverse_of
from coheft.estimation.moments import rows
from coheft.estimation.moments.rows import FLEXING_SIZE, KINEMATICS_SIZE, ROW_SIZE, WRENCH_SIZE, RowNoise
from coheft.estimation.moments.sensor_errors import MORE, ONE, RATES, Corrections
from coheft.estimation.moments.unknowns import LOAD_SIZE, THETA, Indices, State, Unknowns
from coheft.estimation.rigid_body.mass_properties import inertia_operator, pack_symmetric, unpack_symmetric
from coheft.estimation.rigid_body.regressor import regressor_coefficients, spatial_inertia

MOTION_SIZE = 19
W, V, A, ALPHA = slice(1, 4), slice(4, 7), slice(7, 10), slice(10, 13)
TWIST, ACCELERATIONS, PRODUCTS = slice(1, 7), slice(7, 13), slice(13, 19)
"""Entries of the motion. Those of a row have the same names; where both are used, the latter are ``rows.W`` etc."""
FORCING = np.r_[0, 7:MOTION_SIZE]
"""Entries of the motion that the wrench depends on: ``(1, a, alpha, products of w)``."""
FORCING_SIZE = 13
REGRESSOR: Array = np.ascontiguousarray(
    regressor_coefficients(with_offset=True)[:FORCING_SIZE, :, [*range(10, LOAD_SIZE), *range(10)]]
)
"""The wrench is ``sum_k motion[FORCING][k] REGRESSOR[k] @ load``, shape (13, 6, 16)."""

_OWN_RATES = slice(RATES, RATES + ROW_SIZE)
_AXES = np.eye(3)
_PACKED = unpack_symmetric(np.eye(6))
_NO_SENSOR = 1e6
"""Assumed noise [N, N·m] of a missing wrench sensor in the total wrench."""
_PRIOR_INFORMATION = 1e-6
"""Small prior information on the motion: keeps the fusion solvable where no sensor measures it."""


def _centripetal(positions: Array) -> Array:
    """``w x (w x p) == result @ products(w)``, shape (..., 3) to (..., 3, 6)."""
    operator = inertia_operator(positions)
    operator[..., :3] -= positions[..., None]
    return operator


_DYADS = _AXES[:, None, :, None] * _AXES[None, :, None, :]
_TURNED = CROSS_OF_AXES[:, None] @ _PACKED
CENTRIPETAL_OF_AXES = _centripetal(_AXES)
"""``w x (w x e_k) == CENTRIPETAL_OF_AXES[k] @ products(w)``, shape (3, 3, 6)."""
PRODUCTS_BY_RATE: Array = pack_symmetric(_DYADS + _DYADS.swapaxes(2, 3)).swapaxes(1, 2)
"""``products(e_k w^T + w e_k^T) == PRODUCTS_BY_RATE[k] @ w``, shape (3, 6, 3)."""
PRODUCTS_BY_TURN: Array = pack_symmetric(_TURNED + _TURNED.swapaxes(2, 3)).swapaxes(1, 2)
"""A small rotation about axis k changes the products by ``PRODUCTS_BY_TURN[k] @ products``, shape (3, 6, 6)."""


@dataclass(frozen=True, eq=False)
class Fusion:
    """Least squares of six numbers of the motion from six numbers of each robot's row.

    Attributes:
        part: Entries of the motion.
        sensors: Entries of a row.
        weight: Inverse variances, shape (N, 6).
        weighted: ``W_i B_i`` with ``B_i`` the columns ``part`` of ``predict_i``, shape (N, 6, 6).
        covariance: ``(sum_i B_i^T W_i B_i)^-1``, shape (6, 6).
        gain: ``covariance @ (W_i B_i)^T``, shape (N, 6, 6).
    """

    part: slice
    sensors: slice
    weight: Array
    weighted: Array
    covariance: Array
    gain: Array

    @staticmethod
    def of(part: slice, sensors: slice, weight: Array, predict: Array) -> Fusion:
        """Fuse with weights (N, 12) and predictions (N, 12, 19)."""
        weight, by_motion = weight[:, sensors], predict[:, sensors, part]
        weighted = weight[:, :, None] * by_motion
        information = weighted.reshape(-1, 6).T @ by_motion.reshape(-1, 6)
        covariance = inverse_of(information + _PRIOR_INFORMATION * np.eye(6))
        return Fusion(part, sensors, weight, weighted, covariance, covariance @ weighted.swapaxes(1, 2))


class BodyModel:
    """The matrices at one state.

    Args:
        state: Poses of all robots, and their sensor errors.
        noise: Noise of rows.
        unknowns: Indices of the unknowns.

    Attributes:
        state, unknowns, noise: As given.
        rotations, positions: Of all grasp frames in the body frame, shapes (N, 3, 3) and (N, 3) [m].
        count: Number of robots.
        one: Index of the constant 1 in an extended row.
        has_rates: Whether rows are extended by their rates.
        features: Length of ``psi``: 19, or 38 with rates, and 6 N more with flexing.
        flexing: Indices of these, shape (N, 6), or (N, 0).
        without_velocity: Indices of all entries of ``psi`` but velocities: neither accelerations nor wrenches, nor the
            derivatives of these, depend on velocities.
        of_twist: Indices of the entries that twists and their derivatives depend on.
        predict: Takes the motion to each robot's ``(w, v, a, slope)``, shape (N, 12, 19).
        predict_products: Takes the products of the motion to those of a robot's row, shape (N, 6, 6).
        shares: Weight of each robot in the mean of products, shape (N,).
        weight: Inverse variances of ``(w, v, a, slope)``, shape (N, 12).
        twist, accelerations: Fusions of ``(w, v)`` and of ``(a, alpha)``.
        fusion_map: Takes calibrated rows and 1 to the motion, shape (19, 24 N + 1).
        motion_map: Takes extended rows to ``psi``, shape (features, X).
        wrench_map: Takes extended rows to the total wrench, shape (6, X).
        adjoints: ``Ad(g_i)``, shape (N, 6, 6).
        motion_noise: Covariance of the noise of ``psi`` in one row, shape (features, features).
        residual_noise: Cross covariance of residuals of motion sensors with ``psi``, shape (N, 12, features); None
            without rates and flexing, where it is zero.
        wrench_covariance: Noise covariance of each robot's calibrated wrench, and of its rates if there are any, in one
            row, 0 where there is no sensor, shape (N, w, w) with w of 6 or 12.
        wrench_noise: Noise covariance of the total wrench, shape (6, 6).
    """

    def __init__(self, state: State, noise: RowNoise, unknowns: Unknowns) -> None:
        # Each attribute is a function of the arguments and of the attributes above it.
        self.state, self.noise, self.unknowns = state, noise, unknowns
        errors, self.count, self.has_rates = unknowns.errors, len(state.poses), unknowns.errors.has_rates
        self.one = ROW_SIZE * self.count
        moving, flexing = MOTION_SIZE * (1 + self.has_rates), FLEXING_SIZE * errors.is_flexing
        self.features = moving + flexing * self.count
        self.flexing: Indices = np.arange(moving, self.features).reshape(self.count, flexing)
        of_velocity, of_acceleration = np.split(self.flexing, 2, axis=1)
        starts = [0, MOTION_SIZE][: 1 + self.has_rates]  # of the motion, and of its rates
        of_motion = [[0], *(first + np.r_[1:4, 7:MOTION_SIZE] for first in starts), of_acceleration.ravel()]
        of_twist = [*(first + np.r_[TWIST] for first in starts), of_velocity.ravel()]
        self.without_velocity: Indices = np.concatenate(of_motion).astype(np.intp)
        self.of_twist: Indices = np.concatenate(of_twist).astype(np.intp)

        self.rotations = np.array([pose.rotation for pose in state.poses])
        self.positions = np.array([pose.translation for pose in state.poses])
        self.predict = _prediction(self.rotations, self.positions)
        self.predict_products = _turned_products(self.rotations.swapaxes(1, 2))
        self.adjoints = _adjoints(self.rotations, self.positions)

        corrections = Corrections(noise, errors, state.calibration, self.count)
        self.weight = 1.0 / corrections.variance(rows.KINEMATICS)
        self.shares = self.weight[:, 0] / max(self.weight[:, 0].sum(), _PRIOR_INFORMATION)
        self.twist = Fusion.of(TWIST, rows.TWIST, self.weight, self.predict)
        self.accelerations = Fusion.of(ACCELERATIONS, rows.ACCELERATIONS, self.weight, self.predict)
        self.motion_noise, self.residual_noise = self._noise_of_features(corrections)
        self.fusion_map = self._fusion_map()
        self.motion_map = self._motion_map()

        wrench_map = np.zeros((6, self.one + 1))
        wrench_map[:, :-1].reshape(6, self.count, ROW_SIZE)[:, :, rows.WRENCH] = self.adjoints.transpose(1, 0, 2)
        self.wrench_map = self._of_extended(wrench_map)
        variance = corrections.variance(rows.WRENCH)
        is_there = np.isfinite(variance)
        self.wrench_covariance = self._wrench_covariance(corrections, np.where(is_there, variance, 0.0))
        in_total = np.where(is_there, variance, _NO_SENSOR**2)
        self.wrench_noise: Array = (self.adjoints * in_total[:, None] @ self.adjoints.swapaxes(1, 2)).sum(axis=0)

    def _noise_of_features(self, corrections: Corrections) -> tuple[Array, Array | None]:
        """Return ``motion_noise`` and ``residual_noise``."""
        motion, errors = np.zeros((self.features, self.features)), self.unknowns.errors
        for fusion in (self.twist, self.accelerations):
            motion[fusion.part, fusion.part] = fusion.covariance / self.noise.slowness
        if not errors.more or self.state.calibration is None:
            return motion, None
        residual = np.zeros((self.count, KINEMATICS_SIZE, self.features))
        if self.has_rates:
            self._add_noise_of_rates(motion, residual, corrections)
        if errors.is_flexing:
            self._add_noise_of_flexing(motion, residual, corrections)
        return motion, residual

    def _add_noise_of_rates(self, motion: Array, residual: Array, corrections: Corrections) -> None:
        """Rates correct late readings, and also give the rates of ``psi``.

        ``cov(psi, psi') = sum G_i L_i S_i G_i^T`` and ``cov(psi') = sum G_i S_i G_i^T`` with the gains ``G_i`` of a
        fusion, the variances ``S_i`` of rates and the correction ``L_i`` by these.
        """
        late = corrections.by_rates(rows.KINEMATICS)
        variance = corrections.variance_of_rates(rows.KINEMATICS) / self.noise.slowness
        for fusion in (self.twist, self.accelerations):
            gain, of_rates = fusion.gain, variance[:, None, fusion.sensors]
            own = (late[:, fusion.sensors, fusion.sensors] * of_rates) @ gain.swapaxes(1, 2)
            both = (gain @ own).sum(axis=0)
            rates = slice(MOTION_SIZE + fusion.part.start, MOTION_SIZE + fusion.part.stop)
            motion[rates, rates] = (gain * of_rates @ gain.swapaxes(1, 2)).sum(axis=0)
            motion[fusion.part, rates], motion[rates, fusion.part] = both, both.T
            residual[:, fusion.sensors, rates] = own - self.predict[:, fusion.sensors, fusion.part] @ both

    def _add_noise_of_flexing(self, motion: Array, residual: Array, corrections: Corrections) -> None:
        """Flexing corrects compliant robots' readings, and is a part of ``psi`` as well.

        ``cov(psi, u_i) = G_i K_i F_i`` and ``cov(u_i) = F_i`` with the variances ``F_i`` of robot i's flexing ``u_i``
        and the correction ``K_i`` by it.
        """
        variance = corrections.variance_of_flexing() / self.noise.slowness
        by_flexing = corrections.by_flexing(rows.KINEMATICS)
        for robot, entries in enumerate(self.flexing):
            motion[entries, entries] = variance[robot]
            own = by_flexing[robot] * variance[robot]
            for fusion in (self.twist, self.accelerations):
                fused = fusion.gain[robot] @ own[fusion.sensors]
                motion[fusion.part, entries] += fused
                motion[entries, fusion.part] += fused.T
                residual[:, fusion.sensors, entries] -= self.predict[:, fusion.sensors, fusion.part] @ fused
            residual[robot, :, entries] += own.T

    def _wrench_covariance(self, corrections: Corrections, variance: Array) -> Array:
        """Return ``wrench_covariance``; ``variance`` (N, 6) is that of wrenches, as effective as ``RowNoise``."""
        own, rates, size = slice(0, WRENCH_SIZE), slice(WRENCH_SIZE, None), len(self.unknowns.errors.wrench)
        result = np.zeros((self.count, size, size))
        result[:, range(WRENCH_SIZE), range(WRENCH_SIZE)] = variance / self.noise.slowness
        if self.has_rates:
            of_rates = corrections.variance_of_rates(rows.WRENCH) / self.noise.slowness
            result[:, range(WRENCH_SIZE, size), range(WRENCH_SIZE, size)] = of_rates
            across = corrections.by_rates(rows.WRENCH) * of_rates[:, None]
            result[:, own, rates], result[:, rates, own] = across, across.swapaxes(1, 2)
        return result

    def _fusion_map(self) -> Array:
        """Return ``fusion_map``, less the gyros' offset ``b``: it gives ``w - b``, and the products of that."""
        gyros, result = self.state.gyros, np.zeros((MOTION_SIZE, self.one + 1))
        result[0, -1] = 1.0
        of_rows = result[:, :-1].reshape(MOTION_SIZE, self.count, ROW_SIZE)
        to_body = self.shares[:, None, None] * _turned_products(self.rotations)
        of_rows[PRODUCTS, :, rows.PRODUCTS] = to_body.transpose(1, 0, 2)
        for fusion in (self.twist, self.accelerations):
            of_rows[fusion.part, :, fusion.sensors] = fusion.gain.transpose(1, 0, 2)
        result[W, -1] -= gyros
        result[PRODUCTS] -= np.tensordot(gyros, PRODUCTS_BY_RATE, axes=1) @ result[W]
        result[PRODUCTS, -1] -= pack_symmetric(np.outer(gyros, gyros))
        by_products = self.predict[:, rows.ACCELERATIONS, PRODUCTS]
        result[ACCELERATIONS] -= (self.accelerations.gain @ by_products).sum(axis=0) @ result[PRODUCTS]
        return result

    def _motion_map(self) -> Array:
        """Return ``motion_map``: the fusion of calibrated rows, then that of their rates, then flexing as it is."""
        of_motion, errors = self._of_extended(self.fusion_map), self.unknowns.errors
        if not errors.more or self.state.calibration is None:
            return of_motion
        more = np.zeros((self.features - MOTION_SIZE, of_motion.shape[1]))
        by_robot = more[:, self.one + 1 :].reshape(len(more), self.count, errors.more)
        if self.has_rates:
            of_rows = self.fusion_map[:, :-1].reshape(MOTION_SIZE, self.count, ROW_SIZE)
            rates = of_rows.swapaxes(0, 1) @ self.state.calibration[:, _OWN_RATES, _OWN_RATES]
            by_robot[:MOTION_SIZE, :, :ROW_SIZE] = rates.swapaxes(0, 1)
        if errors.is_flexing:
            for robot, entries in enumerate(self.flexing - MOTION_SIZE):
                by_robot[entries, robot, -FLEXING_SIZE:] = np.eye(FLEXING_SIZE)
        return np.vstack([of_motion, more])

    def _of_extended(self, matrix: Array) -> Array:
        """Convert a matrix for calibrated rows (k, 24 N + 1) into one for extended rows as measured (k, X)."""
        calibration, count = self.state.calibration, self.count
        if calibration is None:
            return matrix
        by_robot = matrix[:, :-1].reshape(len(matrix), count, ROW_SIZE).swapaxes(0, 1) @ calibration[:, :ROW_SIZE]
        of_rows, more = by_robot[:, :, :ROW_SIZE].swapaxes(0, 1), by_robot[:, :, MORE:].swapaxes(0, 1)
        constant = matrix[:, -1] + by_robot[:, :, ONE].sum(axis=0)
        return np.hstack([of_rows.reshape(len(matrix), -1), constant[:, None], more.reshape(len(matrix), -1)])

    def predicted_rows(self) -> Array:
        """Return matrices that take ``psi`` to calibrated rows without wrenches, shape (N, width, features)."""
        result = np.zeros((self.count, self.unknowns.errors.width, self.features))
        result[:, rows.KINEMATICS, :MOTION_SIZE] = self.predict
        result[:, rows.PRODUCTS, PRODUCTS], result[:, ONE, 0] = self.predict_products, 1.0
        if self.has_rates:
            of_rates = result[:, _OWN_RATES, MOTION_SIZE : 2 * MOTION_SIZE]
            of_rates[:, rows.KINEMATICS], of_rates[:, rows.PRODUCTS, PRODUCTS] = self.predict, self.predict_products
        own = np.arange(self.unknowns.errors.width)[self.unknowns.errors.flexing]
        result[np.arange(self.count)[:, None], own, self.flexing] = 1.0
        return result

    def prediction_derivatives(self) -> Array:
        """Derivatives of ``predict_i`` by the perturbation of robot i's own pose, shape (N, 6, 12, features)."""
        count, to_own = self.count, self.rotations.swapaxes(1, 2)
        to_own_of_turned = to_own[:, None] @ CROSS_OF_AXES  # the axis of the turn second
        in_body_axes = self.rotations[:, None] @ self.predict.reshape(count, 4, 3, MOTION_SIZE)
        result = np.zeros((count, 6, KINEMATICS_SIZE, self.features))
        turned = to_own_of_turned[:, :, None] @ in_body_axes[:, None]
        result[:, :3, :, :MOTION_SIZE] = -turned.reshape(count, 3, KINEMATICS_SIZE, MOTION_SIZE)
        result[:, 3:, rows.V, W] = result[:, 3:, rows.A, ALPHA] = -to_own_of_turned
        result[:, 3:, rows.A, PRODUCTS] = to_own[:, None] @ CENTRIPETAL_OF_AXES
        return result

    def adjoint_derivatives(self) -> Array:
        """Derivatives of ``Ad(g_i)`` by the perturbation of ``g_i``, shape (N, 6, 6, 6), the perturbation second."""
        turned = CROSS_OF_AXES @ self.rotations[:, None]
        result = np.zeros((self.count, 6, 6, 6))
        result[:, :3, :3, :3] = result[:, :3, 3:, 3:] = result[:, 3:, 3:, :3] = turned
        result[:, :3, 3:, :3] = skew(self.positions)[:, None] @ turned
        return result

    def residuals(self, extended_rows: Array, motion: Array) -> Array:
        """Return readings of all motion sensors less their predictions in standard deviations, those of a robot side by
        side, shape (n, 12 N), from extended rows (n, X) and their ``psi`` without rates (n, 19).
        """
        predicted = motion @ self.predict.reshape(-1, MOTION_SIZE).T
        read = self.calibrated(extended_rows.T).transpose(2, 0, 1).reshape(predicted.shape)
        return np.sqrt(self.weight).ravel() * (read - predicted)

    def calibrated(self, of_rows: Array) -> Array:
        """Correct readings of motion sensors by the sensor errors of the state: takes extended rows as columns, or
        their moments with k numbers, shape (X, k), to those of all robots' ``(w, v, a, slope)``, shape (N, 12, k).
        """
        calibration, count = self.state.calibration, self.count
        by_robot = of_rows[: self.one].reshape(count, ROW_SIZE, -1)
        if calibration is None:
            return by_robot[:, rows.KINEMATICS]
        own = calibration[:, rows.KINEMATICS]
        result: Array = own[:, :, :ROW_SIZE] @ by_robot + own[:, :, ONE, None] * of_rows[self.one]
        if self.unknowns.errors.more:
            result += own[:, :, MORE:] @ of_rows[self.one + 1 :].reshape(count, self.unknowns.errors.more, -1)
        return result


def _prediction(rotations: Array, positions: Array) -> Array:
    """Return ``predict`` of robots with these poses, shapes (N, 3, 3) and (N, 3)."""
    to_own, lever = rotations.swapaxes(1, 2), skew(positions)
    result = np.zeros((len(positions), KINEMATICS_SIZE, MOTION_SIZE))
    result[:, rows.W, W] = result[:, rows.V, V] = result[:, rows.A, A] = result[:, rows.SLOPE, ALPHA] = to_own
    result[:, rows.V, W] = result[:, rows.A, ALPHA] = -to_own @ lever
    result[:, rows.A, PRODUCTS] = to_own @ _centripetal(positions)
    return result


def _turned_products(rotations: Array) -> Array:
    """``products(R w) == result @ products(w)``, shape (N, 3, 3) to (N, 6, 6)."""
    return pack_symmetric(rotations[:, None] @ _PACKED @ rotations.swapaxes(1, 2)[:, None]).swapaxes(1, 2)


def _adjoints(rotations: Array, positions: Array) -> Array:
    """Return ``Ad(g_i)`` of robots with these poses."""
    result = np.zeros((len(positions), 6, 6))
    result[:, :3, :3] = result[:, 3:, 3:] = rotations
    result[:, 3:, :3] = skew(positions) @ rotations
    return result


def load_operator(load: Array) -> Array:
    """Return the map from ``motion[FORCING]`` to the total wrench of a load (16,), offset included, shape (6, 13)."""
    return (REGRESSOR @ load).T


def residual_covariance(body: BodyModel, load: Array) -> Array:
    """Covariance (6, 6) of ``wrench - load_operator @ motion``; noise of the motion enters through the inertia."""
    spatial = spatial_inertia(load[THETA])
    return body.wrench_noise + spatial @ body.accelerations.covariance @ spatial.T

"""The body's motion from the sensors of all robots: per sample, weighted least squares over sums of the network.

Think of every sensor as a particle that is fixed to the body and weighs ``1 / sigma^2``. Then

- velocities and gyros say what the momentum of these particles is (a gyro's particle only resists turning), and their
  information about the twist is their spatial inertia;
- accelerometers say what wrench moves their particles, and their information about ``(a, alpha)`` is again their
  spatial inertia. The best ``(a, alpha)`` is the forward dynamics of this "rigid body", centripetal term included.

So what the robots sum are wrenches and momenta, which ``Pose.adjoint`` carries exactly, and spatial inertias ``M``,
carried by ``Ad M Ad^T``; the covariance of the total wrench is carried in the same way.

Of each sample the network sums ``CHANNELS`` = 18 numbers (``summands``). What does not change from sample to sample,
three 6x6 matrices (``robot_constants``), everybody adds up by itself from the poses of all. In these sums linear
quantities come first: ``(f, t)``, ``(v, w)``, ``(a, alpha)``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from coheft.estimation.body_motion import BODY_A, BODY_ALPHA, BODY_V, BODY_W, MOTION_SIZE
from coheft.estimation.inertia import products_wrench, symmetric_products
from coheft.estimation.measurement import ACCELERATION, GYRO, VELOCITY, WRENCH, SensorNoise
from coheft.estimation.spatial import Array, Pose

CHANNELS = 18
DERIVATIVE_SPAN = 0.02
"""Half the time over which a gyro is differentiated, where accelerometers do not see all of alpha [s]."""
_SMALLEST_DEVIATION = 1e-9
"""Sensors without noise would have infinite weight."""
_DERIVATIVE_IS_BETTER = 10.0
"""The gyro's derivative is called in where it is this many times as informative as the accelerometers. It is not used
elsewhere, because the noise of differences is not white."""


def summands(samples: Array, noise: SensorNoise) -> Array:
    """What one robot adds to the network's sum, for each sample, in its own frame.

    Args:
        samples: Shape (B, 15), see ``MeasurementBlock``.
        noise: Of this robot's sensors.

    Returns:
        Shape (B, 3, 6): the wrench ``(f, t)``, ``(a, 0) / sigma_a^2`` and ``(v / sigma_v^2, w / sigma_w^2)``. Each of
        the three rows is carried to ``F_i`` by ``row @ pose_j_in_i.adjoint().T``.
    """
    w_weight, v_weight, a_weight = _weights(noise)
    sums = np.zeros((len(samples), 3, 6))
    sums[:, 0] = samples[:, WRENCH]
    sums[:, 1, :3] = a_weight * samples[:, ACCELERATION]
    sums[:, 2, :3] = v_weight * samples[:, VELOCITY]
    sums[:, 2, 3:] = w_weight * samples[:, GYRO]
    return sums


def robot_constants(noise: SensorNoise) -> Array:
    """What one robot adds to the sum of the team's constants, in its own frame.

    Returns:
        Shape (3, 6, 6), in the order of ``summands``: covariance of its wrench, its information about ``(a, alpha)``
        and about ``(v, w)``. Carried by ``carried_constants``.
    """
    w_weight, v_weight, a_weight = _weights(noise)
    rows = ([noise.force**2, noise.torque**2], [a_weight, 0.0], [v_weight, w_weight])
    return np.array([np.diag(np.repeat(row, 3)) for row in rows])


def carried_constants(constants: Array, pose_j_in_i: Pose) -> Array:
    """Constants (3, 6, 6) known in ``F_j``, or a sum of them, seen from ``F_i``: ``Ad M Ad^T``."""
    adjoint = pose_j_in_i.adjoint()
    result: Array = adjoint @ constants @ adjoint.T
    return result


def derivative_kernel(half_span: int, period: float) -> Array:
    """Weights of the slope, in the middle, of the cubic through ``2 half_span + 1`` samples (Savitzky, Golay 1964).

    Args:
        half_span: Samples on either side of the middle one, at least 2.
        period: Time between samples [s].

    Returns:
        Shape (2 half_span + 1,) [1/s]; white noise of standard deviation s becomes ``s * norm(kernel)``. A sinusoid of
        angular frequency W loses less than the share ``(W half_span period)^4 / 350``.
    """
    steps = np.arange(-half_span, half_span + 1) / half_span
    slope: Array = np.linalg.pinv(np.vander(steps, 4, increasing=True))[1]
    return slope / (half_span * period)


def slope_kernel(rate: float, longest: int) -> Array:
    """The ``derivative_kernel`` for gyros.

    Args:
        rate: Samples per second.
        longest: Samples on either side that there are at most.
    """
    return derivative_kernel(max(2, min(longest, round(DERIVATIVE_SPAN * rate))), 1.0 / rate)


def derivative(w: Array, kernel: Array) -> Array:
    """Slope of consecutive samples: (B + 2 half_span, 3) of ``w`` to (B, 3) of ``alpha``, for the middle B."""
    windows = np.lib.stride_tricks.sliding_window_view(w, len(kernel), axis=0)
    result: Array = windows @ kernel
    return result


@dataclass(frozen=True, eq=False)
class MotionFusion:
    """Constant matrices that turn the network's sums into the body's motion, for one geometry of grasps.

    Attributes:
        deviations: Standard deviations of the noise in the network's sums, shape (3, 6).
        wrench_covariance: Of the total wrench ``(F, T)``, shape (6, 6).
        acceleration_covariance: Of the fused ``(a, alpha)``, shape (6, 6). Noise of ``w`` in the centripetal term is
            left out: it adds under 1 % at any speed at which people would let robots carry things.
        velocity_covariance: Of the fused ``(v, w)``, shape (6, 6).
        derivative_gain: Shape (3, 6), takes the gyro's derivative to its share of the information vector; None where
            the accelerometers see all of ``alpha`` and no derivative is needed.
        centripetal: Shape (6, 6), takes products of ``w`` to the part of the accelerometers' sum that they explain.
    """

    deviations: Array
    wrench_covariance: Array
    acceleration_covariance: Array
    velocity_covariance: Array
    derivative_gain: Array | None
    centripetal: Array

    @staticmethod
    def of_robots(noise: SensorNoise, poses: Iterable[Pose], kernel: Array) -> MotionFusion:
        """Of robots with the same noise, at these poses; ``kernel`` as for ``of``."""
        constants = robot_constants(noise)
        return MotionFusion.of(np.sum([carried_constants(constants, pose) for pose in poses], axis=0), kernel)

    @staticmethod
    def of(constants: Array, kernel: Array) -> MotionFusion:
        """From the sum of ``robot_constants`` (3, 6, 6) over all robots, carried to one frame.

        Args:
            constants: Sum over all robots.
            kernel: ``derivative_kernel`` of the samples.
        """
        wrench_covariance, acceleration_information, velocity_information = constants
        velocity_covariance = np.linalg.inv(velocity_information)
        unseen = _unseen_information(acceleration_information, velocity_covariance[3:, 3:] * float(kernel @ kernel))
        information = acceleration_information.copy()
        information[3:, 3:] += unseen
        gain = np.zeros((3, 6))
        gain[:, 3:] = unseen
        return MotionFusion(
            deviations=np.sqrt(np.diagonal(constants, axis1=1, axis2=2)),
            wrench_covariance=wrench_covariance,
            acceleration_covariance=np.linalg.inv(information),
            velocity_covariance=velocity_covariance,
            derivative_gain=gain if unseen.any() else None,
            centripetal=products_wrench(acceleration_information),
        )

    @property
    def slope_information(self) -> Array:
        """What the gyros' derivative says about ``(a, alpha)``, shape (6, 6)."""
        information = np.zeros((6, 6))
        if self.derivative_gain is not None:
            information[3:] = self.derivative_gain
        return information

    def angular_velocity(self, sums: Array) -> Array:
        """Fused ``w`` in ``F_i``, shape (B, 3) [rad/s], of sums (B, 3, 6): what ``derivative`` wants."""
        result: Array = sums[:, 2] @ self.velocity_covariance[:, 3:]
        return result

    def motion(self, sums: Array, w_derivative: Array | None = None) -> Array:
        """Body motion at ``F_i``.

        Args:
            sums: The network's sum of ``summands``, in ``F_i``, shape (B, 3, 6).
            w_derivative: Shape (B, 3) [rad/s²]; needed where ``derivative_gain`` is not None, else ignored.

        Returns:
            ``(w, v, a, alpha)``, shape (B, 12).

        Raises:
            ValueError: The derivative is needed and missing.
        """
        motion = np.empty((len(sums), MOTION_SIZE))
        velocity = sums[:, 2] @ self.velocity_covariance
        motion[:, BODY_V], motion[:, BODY_W] = velocity[:, :3], velocity[:, 3:]
        vector = sums[:, 1] - symmetric_products(motion[:, BODY_W]) @ self.centripetal
        if self.derivative_gain is not None:
            if w_derivative is None:
                raise ValueError("the accelerometers do not see all of alpha: w_derivative expected, found None")
            vector += w_derivative @ self.derivative_gain
        motion[:, BODY_A.start : BODY_ALPHA.stop] = vector @ self.acceleration_covariance
        return motion


def _weights(noise: SensorNoise) -> tuple[float, float, float]:
    w, v, a = (max(sigma, _SMALLEST_DEVIATION) ** -2 for sigma in (noise.gyro, noise.velocity, noise.acceleration))
    return w, v, a


def _unseen_information(acceleration_information: Array, derivative_covariance: Array) -> Array:
    """Information (3, 3) of the gyro's derivative about ``alpha``, only in directions that the accelerometers miss."""
    coupling = acceleration_information[3:, :3]
    seen = acceleration_information[3:, 3:] - coupling @ coupling.T / acceleration_information[0, 0]
    root = np.linalg.cholesky(derivative_covariance)
    shares, directions = np.linalg.eigh(root.T @ seen @ root)
    missed = np.linalg.solve(root.T, directions[:, shares * _DERIVATIVE_IS_BETTER < 1.0])
    result: Array = missed @ missed.T
    return result

"""Angular acceleration from the neighbours' accelerometers and the own gyro (Fan et al., eqs 16, 17)."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from coheft.estimation.fan2017.systematic import pose_error_transport
from coheft.estimation.geometry.spatial import Array, Pose, skew
from coheft.estimation.measurement import SensorNoise


def gyro_derivative(previous: Array, gyro: Array, following: Array, rate: float) -> Array:
    """Central difference of a block of gyro samples (eq. 16), without delay.

    Args:
        previous: The sample before the block, shape (3,) [rad/s].
        gyro: The block, shape (B, 3).
        following: The sample after the block, shape (3,).
        rate: Samples per second.

    Returns:
        Shape (B, 3) [rad/s²]; the variance of its noise is ``sigma_w^2 rate^2 / 2``.
    """
    extended = np.vstack([previous, gyro, following])
    return 0.5 * rate * (extended[2:] - extended[:-2])


@dataclass(frozen=True, eq=False)
class AngularAcceleration:
    """``alpha_i`` by least squares over the own and the neighbours' accelerometers and the differentiated gyro.

    A neighbour at ``p_ij`` sees ``R_ij a_j = a_i + alpha_i x p_ij + w_i x (w_i x p_ij)`` (eq. 17). All these equations
    share the noise of the own accelerometer; with ``a_i`` as one more unknown, only the positions relative to the
    centre of the sensors count. Sensors on a line do not show alpha along it; the gyro's derivative does, with a large
    variance.

    Attributes:
        poses_j_in_i: The neighbours' poses.
        noise: Of all sensors involved.
        rate: Samples per second.
        with_accelerometers: Whether eq. (17) is used; else the gyro's derivative alone.
    """

    poses_j_in_i: Sequence[Pose]
    noise: SensorNoise
    rate: float
    with_accelerometers: bool = True

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the estimate, shape (3, 3) [rad²/s⁴]."""
        crosses = skew(self._arms)
        information = np.einsum("nki,nkj->ij", crosses, crosses) / self.noise.acceleration**2
        return np.linalg.inv(information + self._gyro_weight * np.eye(3))

    def estimate(self, gyro_derivative: Array, gyro: Array, acceleration: Array, others: Sequence[Array]) -> Array:
        """``alpha_i`` of a block, shape (B, 3) [rad/s²].

        Args:
            gyro_derivative: Own, shape (B, 3) [rad/s²].
            gyro: Own ``w_i``, shape (B, 3) [rad/s].
            acceleration: Own ``a_i``, shape (B, 3) [m/s²].
            others: The neighbours' ``a_j`` in their own frames, shape (B, 3) each.
        """
        transported = [other @ pose.rotation.T for pose, other in zip(self.poses_j_in_i, others, strict=True)]
        moment = self._gyro_weight * gyro_derivative
        crosses = skew(gyro)
        centripetal = crosses @ crosses
        for arm, lever, seen in zip(self._arms, self._levers, [acceleration, *transported], strict=True):
            moment += (seen - centripetal @ arm) @ lever.T
        return moment @ self.covariance

    def by_pose_error(self, gyro: Array, alpha: Array, others: Sequence[Array]) -> Array:
        """Return the error of ``alpha_i`` per unit of the own pose error ``(theta, p)``: the neighbours seem to move.

        Args:
            gyro: Own ``w_i``, shape (B, 3) [rad/s].
            alpha: The estimate, shape (B, 3) [rad/s²].
            others: The neighbours' ``a_j`` in their own frames, shape (B, 3) each.

        Returns:
            Shape (B, 3, 6): by the rotation and the translation.
        """
        result = np.zeros((len(gyro), 3, 6))
        crosses = skew(gyro)
        field = skew(alpha) + crosses @ crosses  # acceleration by distance
        by_pose = np.empty_like(result)
        by_pose[:, :, 3:] = field
        for (gain, transport), pose, other in zip(self._by_acceleration, self.poses_j_in_i, others, strict=True):
            by_pose[:, :, :3] = skew(other @ pose.rotation.T)
            result += gain @ by_pose @ transport
        return result

    @cached_property
    def _levers(self) -> Array:
        """Weighted cross-product matrices of the arms, shape (1 + neighbours, 3, 3)."""
        return skew(self._arms) / self.noise.acceleration**2

    @cached_property
    def _by_acceleration(self) -> list[tuple[Array, Array]]:
        """Of each neighbour, the derivative of alpha by its acceleration (3, 3), and ``pose_error_transport`` to it."""
        gains = self.covariance @ self._levers[1:]
        transports = [pose_error_transport(pose.translation) for pose in self.poses_j_in_i]
        return list(zip(gains, transports, strict=True))

    @cached_property
    def _arms(self) -> Array:
        """Positions of all accelerometers, the own first, relative to their centre, shape (1 + neighbours, 3) [m]."""
        if not self.with_accelerometers:
            return np.zeros((1 + len(self.poses_j_in_i), 3))  # without lever arms accelerometers have no effect
        positions = np.array([np.zeros(3), *(pose.translation for pose in self.poses_j_in_i)])
        result: Array = positions - positions.mean(axis=0)
        return result

    @property
    def _gyro_weight(self) -> float:
        return 2.0 / (self.noise.gyro * self.rate) ** 2

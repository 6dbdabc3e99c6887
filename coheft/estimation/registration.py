"""Registration of one robot's own sensors against the motion of the body that the whole network has agreed on.

The body frame moves with ``(w, v, a, alpha)``; sensors at ``F_i``, with pose ``(R, p)`` in the body frame, read

    w_i = R^T w,   v_i = R^T (v + w x p),   a_i = R^T (a + alpha x p + w x (w x p)).

The residuals are linear in ``FEATURES`` = 28 numbers per sample: 1, the robot's own ``(w_i, v_i, a_i)``, the body's
``(w, v, a, alpha)``, and six products of ``w``. So their Gram matrix holds all that the samples say about the pose:
cost, score and Gauss-Newton information, at any pose, without the samples.

``team_registration`` puts the scores of all robots together.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from coheft.estimation.body_motion import BODY_W, MOTION_SIZE
from coheft.estimation.inertia import symmetric_products
from coheft.estimation.measurement import SensorNoise, kinematic_weights
from coheft.estimation.rigid_body import inertia_operator
from coheft.estimation.spatial import CROSS_OF_AXES, Array, Pose, skew

FEATURES = 28
OWN = slice(1, 10)
MOTION = slice(10, 22)
TWIST, ACCELERATION, PRODUCTS = slice(10, 16), slice(16, 22), slice(22, 28)
TWIST_ROWS, ACCELERATION_ROWS = slice(0, 6), slice(6, 9)
ALPHA = slice(19, 22)
_POSES = 64
"""Operators of so many poses are kept: block after block is held against the same ones."""
_SINGULAR = 1e-12
"""What is added to an information, relative to itself, so that it has an inverse."""
_W, _V, _A = slice(10, 13), slice(13, 16), slice(16, 19)


@dataclass(frozen=True, eq=False)
class RegistrationMoments:
    """Sums over samples that a robot's own pose is found from. Add up those of several blocks.

    Attributes:
        gram: ``Z^T Z`` of the features' rows, shape (28, 28).
    """

    gram: Array

    @staticmethod
    def none() -> RegistrationMoments:
        """Of no samples."""
        return RegistrationMoments(np.zeros((FEATURES, FEATURES)))

    @staticmethod
    def of(own: Array, motion: Array) -> RegistrationMoments:
        """Of simultaneous samples.

        Args:
            own: What the robot's sensors read, ``(w_i, v_i, a_i)``, shape (n, 9).
            motion: Motion of the body frame, shape (n, 12).

        Raises:
            ValueError: Shapes do not fit.
        """
        if own.shape[1:] != (9,) or motion.shape != (len(own), MOTION_SIZE):
            raise ValueError(f"{own.shape=} and {motion.shape=} but expected (n, 9) and (n, 12)")
        rows = np.empty((len(own), FEATURES))
        registration_features(own, motion, out=rows)
        return RegistrationMoments(rows.T @ rows)

    def __add__(self, other: RegistrationMoments) -> RegistrationMoments:
        return RegistrationMoments(self.gram + other.gram)

    def mapped(self, feature_map: Array) -> RegistrationMoments:
        """As if every sample's features had been ``feature_map`` (28, 28) times what they were."""
        return RegistrationMoments(feature_map @ self.gram @ feature_map.T)

    @property
    def count(self) -> float:
        """Number of samples."""
        return float(self.gram[0, 0])

    def centred(self) -> Array:
        """The Gram matrix of the features with their means removed."""
        total = self.gram[0]
        result: Array = self.gram - total[:, None] * (total / max(self.count, 1.0))
        return result


def registration_features(own: Array, motion: Array, out: Array) -> None:
    """Put features of samples into the first columns of ``out``, shape (n, 28 or more).

    Args:
        own: What the robot's sensors read, ``(w_i, v_i, a_i)``, shape (n, 9).
        motion: Motion of the body frame, shape (n, 12).
        out: Where to.
    """
    out[:, 0], out[:, OWN], out[:, MOTION] = 1.0, own, motion
    out[:, PRODUCTS] = symmetric_products(motion[:, BODY_W])


_OWN_AXES = np.eye(9)


@lru_cache(maxsize=_POSES)
def residual_operator(pose: Pose) -> Array:
    """Matrix (9, 28) from a sample's features to its residuals of gyro, velocity and accelerometer; read only."""
    operator = _residual_operator(pose.rotation.T, pose.translation)
    operator.flags.writeable = False
    return operator


def _residual_operator(to_i: Array, p: Array) -> Array:
    operator = np.zeros((9, FEATURES))
    operator[:, OWN] = _OWN_AXES
    operator[0:3, _W] = operator[3:6, _V] = operator[6:9, _A] = -to_i
    operator[3:6, _W] = operator[6:9, ALPHA] = to_i @ skew(p)
    operator[6:9, PRODUCTS] = -to_i @ centripetal_operator(p)
    return operator


def centripetal_operator(p: Array) -> Array:
    """Matrix (3, 6) with ``w x (w x p) == result @ symmetric_products(w)``."""
    operator: Array = inertia_operator(p)
    operator[:, :3] -= p[:, None]
    return operator


_CENTRIPETAL_OF_AXES = np.array([centripetal_operator(axis) for axis in np.eye(3)])


@lru_cache(maxsize=_POSES)
def residual_derivative(pose: Pose) -> Array:
    """Derivatives of ``residual_operator`` by the pose's perturbation, shape (6, 9, 28), the perturbation first."""
    p, to_i = pose.translation, pose.rotation.T
    derivative = np.zeros((6, 9, FEATURES))
    in_body_axes = _residual_operator(np.eye(3), p)[:, MOTION.start :].reshape(3, 3, -1)
    turned = to_i @ CROSS_OF_AXES
    derivative[:3, :, MOTION.start :] = (-turned[:, None] @ in_body_axes).reshape(3, 9, -1)
    derivative[3:, 3:6, _W] = derivative[3:, 6:9, ALPHA] = turned
    derivative[3:, 6:9, PRODUCTS] = -to_i @ _CENTRIPETAL_OF_AXES
    derivative.flags.writeable = False
    return derivative


def score_and_information(moments: RegistrationMoments, pose: Pose, noise: SensorNoise) -> tuple[Array, Array, float]:
    """Score (6,) and Gauss-Newton information (6, 6) of the pose's perturbation, and the cost (half chi-square).

    The body's motion is taken as it is. Constant offsets of gyro and velocity are allowed for: these residuals are
    centred. The accelerometer's are not, because gravity, nearly constant, says most about the rotation.
    """
    weights, derivative = kinematic_weights(noise), residual_derivative(pose)
    score, information, cost = np.zeros(6), np.zeros((6, 6)), 0.0
    for rows, gram, weighted, operator in _residuals(moments, pose, noise):
        changes = derivative[:, rows].reshape(6, -1)
        score -= changes @ weighted.ravel()
        information += (weights[rows, None] * derivative[:, rows] @ gram).reshape(6, -1) @ changes.T
        cost += 0.5 * float(np.vdot(weighted, operator))
    return score, information, cost


def half_squares(moments: RegistrationMoments, pose: Pose, noise: SensorNoise) -> float:
    """The cost alone, as of ``score_and_information``."""
    return 0.5 * sum(float(np.vdot(weighted, each)) for _, _, weighted, each in _residuals(moments, pose, noise))


def _residuals(
    moments: RegistrationMoments, pose: Pose, noise: SensorNoise
) -> Iterator[tuple[slice, Array, Array, Array]]:
    """Of twists and accelerations: rows, the features' moments, their weighted ones with residuals, and operator."""
    operator, weights = residual_operator(pose), kinematic_weights(noise)
    for rows, gram in ((TWIST_ROWS, moments.centred()), (ACCELERATION_ROWS, moments.gram)):
        yield rows, gram, weights[rows, None] * (operator[rows] @ gram), operator[rows]


def least_squares(score: Array, information: Array, cost: float) -> float:
    """Squared residuals in units of the noise at the best pose, by what ``score_and_information`` gives at one nearby.

    9 for each sample at most, where there is nothing but noise.
    """
    ridge = _SINGULAR * np.trace(information) * np.eye(6)
    return 2.0 * cost - float(score @ np.linalg.solve(information + ridge, score))

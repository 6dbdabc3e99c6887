"""The same results as the kernels', in plain numpy, sample by sample: what they are timed against.

The two recursions are the seed papers': one dual-quaternion update per sample for the pose, one least-squares update
per sample for the inertia. They are written as fast as single samples allow.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coheft.estimation.spatial import Array, Pose


class PoseRecursion:
    """Dual-quaternion recursion: moments ``A = sum H(w)^T H(w)`` and ``B = sum H(w)^T H(v)``, one sample at a time."""

    def __init__(self) -> None:
        self.rotation_moment = np.zeros((4, 4))
        self.mixed_moment = np.zeros((4, 4))

    def update(self, twist_i: Array, twist_j: Array) -> None:
        """Take in one sample ``(w, v)`` of each frame, shape (6,)."""
        by_w, by_v = _pair(twist_i[:3], twist_j[:3]), _pair(twist_i[3:], twist_j[3:])
        self.rotation_moment += by_w.T @ by_w
        self.mixed_moment += by_w.T @ by_v

    def solve(self) -> tuple[Array, Array]:
        """``q_r`` and ``q_d``."""
        q_r = np.linalg.eigh(self.rotation_moment)[1][:, 0]
        system = np.zeros((5, 5))
        system[:4, :4] = self.rotation_moment
        system[:4, 4] = system[4, :4] = q_r
        right_side = np.append(-self.mixed_moment @ q_r, 0.0)
        return q_r, np.linalg.solve(system + 1e-12 * np.eye(5), right_side)[:4]


def _pair(a: Array, b: Array) -> Array:
    """``H(a, b) = L(a) - R(b)``."""
    x, y, z = (a - b).tolist()
    u, v, w = (a + b).tolist()
    return np.array([[0.0, -x, -y, -z], [x, 0.0, -w, v], [y, w, 0.0, -u], [z, -v, u, 0.0]])


class InertiaRecursion:
    """Recursive least squares for ``(m, m h, I_o)``: one wrench at a time.

    Args:
        wrench_covariance: Of the wrench's noise, shape (6, 6).
        prior: Information beforehand, shape (10, 10), at zero.
    """

    def __init__(self, wrench_covariance: Array, prior: Array) -> None:
        self._noise = wrench_covariance
        self.covariance = np.linalg.inv(prior)
        self.parameters = np.zeros(10)

    def update(self, regressor: Array, wrench: Array) -> None:
        """Take in one sample: ``wrench = regressor @ parameters``, shapes (6, 10) and (6,)."""
        carried = self.covariance @ regressor.T
        gain = np.linalg.solve(regressor @ carried + self._noise, carried.T).T
        self.parameters = self.parameters + gain @ (wrench - regressor @ self.parameters)
        self.covariance = self.covariance - gain @ carried.T


def regressor(motion: Array) -> Array:
    """Of one sample of body motion ``(w, v, a, alpha)``, shape (12,) to (6, 10)."""
    w, a, alpha = motion[:3], motion[6:9], motion[9:]
    cross_w = _cross(w)
    result = np.zeros((6, 10))
    result[:3, 0] = a
    result[:3, 1:4] = _cross(alpha) + cross_w @ cross_w
    result[3:, 1:4] = -_cross(a)
    result[3:, 4:] = _inertia_operator(alpha) + cross_w @ _inertia_operator(w)
    return result


def _cross(x: Array) -> Array:
    a, b, c = x.tolist()
    return np.array([[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]])


def _inertia_operator(x: Array) -> Array:
    a, b, c = x.tolist()
    return np.array([[a, 0.0, 0.0, b, c, 0.0], [0.0, b, 0.0, a, 0.0, c], [0.0, 0.0, c, 0.0, a, b]])


def consensus_round(own: Array, others: Sequence[Array], gains: Array) -> Array:
    """One round, sample by sample: shapes (K, B, C) each, gains (K,) of every neighbour."""
    result = np.empty_like(own)
    for stage, gain in enumerate(gains):
        for sample in range(own.shape[1]):
            value = own[stage, sample]
            result[stage, sample] = value + gain * sum(other[stage, sample] - value for other in others)
    return result


def acceleration(poses: Sequence[Pose], w: Array, readings: Array) -> Array:
    """``(a, alpha)`` of the body by least squares over all accelerometers, one sample at a time.

    Args:
        poses: Of the sensors in the body frame.
        w: Angular velocity of the body, shape (n, 3).
        readings: Of the accelerometers, each in its own frame, shape (N, n, 3).
    """
    result = np.empty((len(w), 6))
    positions = [pose.translation for pose in poses]
    design = np.vstack([np.hstack([np.eye(3), -_cross(position)]) for position in positions])
    for k in range(len(w)):
        turned = [pose.rotation @ reading[k] for pose, reading in zip(poses, readings, strict=True)]
        spin = _cross(w[k]) @ _cross(w[k])
        right_side = np.concatenate([turn - spin @ position for turn, position in zip(turned, positions, strict=True)])
        result[k] = np.linalg.lstsq(design, right_side, rcond=None)[0]
    return result

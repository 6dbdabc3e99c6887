"""Motion of the load, and the total wrench on it, in a frame fixed to it: the body frame."""

from collections.abc import Sequence

import numpy as np

from coheft.estimation.batch.signals import Signals
from coheft.estimation.geometry.body_motion import grasp_measurements
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.regressor import features, regressor_coefficients

_COEFFICIENTS = regressor_coefficients(with_offset=False)[:, :, :-1]


def body_motions(signals: Signals, poses: Sequence[Pose]) -> Array:
    """Motion ``(w, v, a, alpha)`` of the body frame, predicted by each robot's own signals, shape (N, n, 12).

    ``poses`` are those of the grasp frames in the body frame.
    """
    motions = []
    own = np.concatenate([signals.w, signals.v, signals.a, signals.alpha], axis=-1)
    for pose, motion in zip(poses, own, strict=True):
        motions.append(np.hstack([grasp_measurements(pose.inverse(), motion), motion[:, 9:] @ pose.rotation.T]))
    return np.array(motions)


def total_wrench(wrenches: Array, poses: Sequence[Pose]) -> Array:
    """Sum ``(F, T)`` about the origin of the body frame, shape (n, 6), of all robots' wrenches (N, n, 6)."""
    result: Array = np.sum([own @ pose.adjoint().T for own, pose in zip(wrenches, poses, strict=True)], axis=0)
    return result


def regressor(motion: Array) -> Array:
    """``Y`` (n, 6, 10) with ``(F, T) = Y theta``, ``theta = (m, m h, I_o)``, of body motions (n, 12)."""
    return np.tensordot(features(motion, np.zeros((len(motion), 6))), _COEFFICIENTS, axes=1)


def centre_of(poses: Sequence[Pose]) -> Pose:
    """Frame at the middle of the grasps, with the first one's axes: no robot's noise has a long lever there."""
    return Pose(np.eye(3), np.mean([pose.translation for pose in poses], axis=0))

"""Noise of the load's motion by frequency, which depends on the channels from which the motion was derived."""

from functools import partial

import numpy as np

from coheft.estimation.batch.judge.band import correlations, white_level
from coheft.estimation.batch.judge.evidence import Evidence
from coheft.estimation.batch.signals import without_jumps
from coheft.estimation.geometry.spatial import Array, skew


def level_of(evidence: Evidence, robot: int, channel: str) -> Array:
    """Standard deviations of the white noise of a robot's samples, shape (c,); of poses (rotation, translation), (6,).

    Raises:
        ValueError: There are too few samples, or too few per second, to tell noise from motion.
    """
    samples = evidence.recording.stacked(channel)[robot]
    if channel == "pose":
        samples = without_jumps(samples)
    level = white_level(samples, evidence.recording.rate, evidence.cutoff)
    if level is None:
        raise ValueError("there are too few samples, or too few per second, to tell noise from motion")
    if channel != "pose":
        return level
    turn, shift = 2.0 * np.sqrt(np.sum(level[3:] ** 2) / 3.0), np.sqrt(np.mean(level[:3] ** 2))
    return np.repeat([turn, shift], 3)


def wrench_noise(evidence: Evidence, robot: int) -> Array:
    """Covariance (6, 6) of the white noise of a robot's wrench.

    Moments that were computed about another point have noise in common with forces.

    Raises:
        ValueError: There are too few samples, or too few per second, to tell noise from motion.
    """
    level, recording = level_of(evidence, robot, "wrench"), evidence.recording
    shared = correlations(recording.stacked("wrench")[robot], recording.rate, evidence.cutoff)
    result: Array = shared * np.outer(level, level)
    return result


def acceleration_noise(evidence: Evidence, robot: int, up: Array, frequency: Array) -> Array:
    """Covariance of the noise of the body's ``(alpha, a)`` according to one robot, by frequency (K,), shape (K, 6, 6).

    Poses are differentiated twice, twists once; orientations also determine the direction of gravity. The mean proper
    acceleration ``up`` (3,) is in the body frame.
    """
    pulsation = 2.0 * np.pi * frequency[:, None]
    turned, noise = np.zeros((len(frequency), 6, 6)), np.zeros((len(frequency), 6))
    pose, has, level = evidence.poses[robot], evidence.recording.has, partial(level_of, evidence, robot)
    if has("dtwist"):
        noise += level("dtwist") ** 2
    elif has("twist"):
        noise += (pulsation * level("twist")) ** 2
    if has("acceleration"):
        noise[:, 3:] = level("acceleration") ** 2
    elif has("pose"):
        turned[:, 3:, :3] = -skew(pose.rotation.T @ up)
    if not has("dtwist") and not has("twist"):
        turned[:, :3, :3] = -(pulsation[..., None] ** 2) * np.eye(3)
        if not has("acceleration"):
            noise[:, 3:] += (pulsation**2 * level("pose")[3:]) ** 2
    own = noise[..., None] * np.eye(6)
    if turned.any():
        own = own + level("pose")[0] ** 2 * turned[..., :3] @ turned[..., :3].swapaxes(-1, -2)
    return pose.adjoint() @ own @ pose.adjoint().T

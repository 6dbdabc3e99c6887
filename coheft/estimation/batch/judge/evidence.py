"""Input of the judge: a recording, its noise, and the grasp poses according to motion only.

Forces are not used for the grasp poses, because their faults would distort these until forces fit.
"""

from dataclasses import dataclass
from functools import partial
from typing import Self

import numpy as np

from coheft.estimation.batch.hand_eye import HandEye, fit_hand_eye
from coheft.estimation.batch.judge.band import HIGHEST, correlations, white_level
from coheft.estimation.batch.pairs import TeamPoses, grasps_from_twists
from coheft.estimation.batch.plausibility import plausible_signals
from coheft.estimation.batch.recording import Recording
from coheft.estimation.batch.signals import Signals, centre_of, signals_of, without_jumps
from coheft.estimation.batch.wrist_poses import Tolerances, WristPoses
from coheft.estimation.geometry.spatial import Array, Pose, skew

POSES_PER_SECOND = 25.0
_LARGEST_TURN, _LARGEST_SHIFT = 1.0, 0.01
"""Largest residuals of poses of one load, averaged over a 25th of a second [degrees, m]."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """Input of the judge for one recording.

    Attributes:
        recording: The recording, with wrenches, corrected for calibration errors if these were estimated.
        signals: Its filtered signals.
        cutoff: Cutoff of the filter [Hz].
        team: Poses of the grasp frames in the first one.
        homes: Poses of the home frames in the first one; none without poses.
        suspicions: A sentence if poses do not fit together, so that forces cannot be judged.
        tolerances: Tolerances of calibration errors that were estimated; None if none were.
        tilt: Standard deviation of the direction of gravity in home frames [rad].
    """

    recording: Recording
    signals: Signals
    cutoff: float
    team: TeamPoses
    homes: tuple[Pose, ...] = ()
    suspicions: tuple[str, ...] = ()
    tolerances: Tolerances | None = None
    tilt: float = 0.0

    @classmethod
    def of(cls, recording: Recording, cutoff: float) -> Self:
        """Find the grasp poses from poses, or without these from twists."""
        cutoff = min(cutoff, HIGHEST * recording.rate)
        signals = plausible_signals(recording, cutoff)
        start, _ = grasps_from_twists(signals, with_instruments=True)
        if not recording.has("pose"):
            return cls(recording, signals, cutoff, start)
        wrists = WristPoses.of(recording.stacked("pose"), recording.rate, at_home=False)
        return cls.of_poses(recording, signals, cutoff, fit_hand_eye(wrists.averaged(POSES_PER_SECOND), start.poses))

    @classmethod
    def of_poses(cls, recording: Recording, signals: Signals, cutoff: float, grasps: HandEye) -> Self:
        """Use grasps that were fitted to poses."""
        if cutoff > (highest := HIGHEST * recording.rate):
            signals, cutoff = signals_of(recording, highest), highest
        return cls(recording, signals, cutoff, grasps.team, grasps.homes, suspicions_about(grasps))

    @property
    def is_seen(self) -> bool:
        """Whether all grasp poses are observable, and there is gravity."""
        return bool(self.recording.gravity.any()) and self.team.is_observable

    @property
    def poses(self) -> tuple[Pose, ...]:
        """Poses of the grasp frames in the body frame, which is at their middle."""
        to_centre = centre_of(self.team.poses).inverse()
        return tuple(to_centre @ pose for pose in self.team.poses)

    def culprit(self, robot: int) -> str | None:
        """Name of a robot whose data do not fit the others'; None if there are only two: either may be wrong."""
        return self.recording.names[robot] if len(self.recording.names) > 2 else None

    @property
    def turns(self) -> float:
        """Largest standard deviation of rotations between grasp frames [rad]."""
        team = self.team
        relative = [team.relative(0, other).covariance for other in range(1, len(team.poses))]
        largest = max(float(np.linalg.eigvalsh(covariance[:3, :3])[-1]) for covariance in relative)
        return float(np.hypot(np.sqrt(largest), self.tilt))


def suspicions_about(grasps: HandEye) -> tuple[str, ...]:
    """Say if poses are not those of one load; a fit that wanders where nothing is observable does not tell."""
    if not grasps.team.is_settled and not grasps.team.is_observable:
        return ()
    turn, shift = float(np.degrees(grasps.noise[0])), grasps.noise[1]
    if turn < _LARGEST_TURN and shift < _LARGEST_SHIFT:
        return ()
    return (
        f"Poses differ by {turn:.2g}° and {1e3 * shift:.2g} mm from those of robots that hold one load. Are all clocks "
        f"alike, positions in metres, quaternions in the order qx qy qz qw, poses those of grasp frames in home frames "
        f"that stand still? Did all robots hold on all the time, and are they calibrated (--calibrate)?",
    )


def level_of(evidence: Evidence, robot: int, channel: str) -> Array:
    """Standard deviations of a robot's white noise, shape (c,); of poses, those of (rotation, translation), (6,)."""
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

"""Input of the judge: a recording, and the grasp poses according to motion only.

Forces are not used for the grasp poses, because their faults would distort these until forces fit.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from coheft.estimation.batch.body import centre_of
from coheft.estimation.batch.calibration import Tolerances
from coheft.estimation.batch.hand_eye import HandEye, fit_hand_eye
from coheft.estimation.batch.judge.band import HIGHEST
from coheft.estimation.batch.pairs import grasps_from_twists
from coheft.estimation.batch.plausibility import plausible_signals
from coheft.estimation.batch.recording import Recording
from coheft.estimation.batch.signals import Signals, signals_of
from coheft.estimation.batch.team_poses import TeamPoses
from coheft.estimation.batch.wrist_poses import WristPoses
from coheft.estimation.geometry.spatial import Pose

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
        f"alike, quaternions in the order qx qy qz qw, poses those of grasp frames in home frames that stand still? "
        f"Did all robots hold on all the time, and are they calibrated (--calibrate)?",
    )

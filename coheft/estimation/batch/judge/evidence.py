"""What a judge looks at: a recording, and where robots hold the load as motion alone has it.

Forces do not say where that is: what is wrong with them would bend it until they fit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from coheft.estimation.batch.body import centre_of
from coheft.estimation.batch.calibration import Tolerances
from coheft.estimation.batch.hand_eye import HandEye, fit_hand_eye
from coheft.estimation.batch.pairs import grasps_from_twists
from coheft.estimation.batch.plausibility import plausible_signals
from coheft.estimation.batch.recording import Recording
from coheft.estimation.batch.signals import Signals, signals_of
from coheft.estimation.batch.team_poses import TeamPoses
from coheft.estimation.batch.wrist_poses import WristPoses
from coheft.estimation.geometry.spatial import Pose

POSES_PER_SECOND = 25.0
_LARGEST_TURN, _LARGEST_SHIFT = 1.0, 0.01
"""Poses that fit worse than this, averaged over a 25th of a second, are not of one load [degrees, m]."""
_PER_SAMPLE = 0.16
"""The filter's cutoff, at most, by the rate: noise is measured above it."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """Of one recording.

    Attributes:
        recording: With wrenches; what a calibration found is taken out of it.
        signals: Of it, filtered.
        cutoff: Of the filter [Hz].
        team: Grasp frames in the first one.
        homes: Home frames in the first one; none without poses.
        suspicions: That poses do not fit together, in words: then forces say nothing.
        tolerances: What is uncertain about sensors beside their noise; None: nothing.
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
        """Find where robots hold the load, from poses if there are any, else from twists.

        Raises:
            RecordingError: Too little was recorded, or what no robots with one load can have recorded.
        """
        cutoff = min(cutoff, _PER_SAMPLE * recording.rate)  # noise is measured above it
        signals = plausible_signals(recording, cutoff)
        start, _ = grasps_from_twists(signals, with_instruments=True)
        if not recording.has("pose"):
            return cls(recording, signals, cutoff, start.team)
        wrists = WristPoses.of(recording.stacked("pose"), recording.rate, at_home=False)
        return cls.of_poses(
            recording, signals, cutoff, fit_hand_eye(wrists.averaged(POSES_PER_SECOND), start.team.poses)
        )

    @classmethod
    def of_poses(cls, recording: Recording, signals: Signals, cutoff: float, grasps: HandEye) -> Self:
        """With grasps that were fitted to poses."""
        highest = _PER_SAMPLE * recording.rate
        if cutoff > highest:
            signals, cutoff = signals_of(recording, highest), highest
        return cls(recording, signals, cutoff, grasps.team, grasps.homes, suspicions_about(grasps))

    @property
    def is_seen(self) -> bool:
        """Whether the motion shows where all robots hold the load, and gravity that it has a weight."""
        team = self.team
        relative = (team.relative(0, other) for other in range(1, len(team.poses)))
        return bool(self.recording.gravity.any()) and not any(pose.unseen for pose in relative)

    @property
    def poses(self) -> tuple[Pose, ...]:
        """Of grasp frames in the body frame, which is at their middle."""
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

    def but(self, recording: Recording) -> Self:
        """With another recording of robots that hold the load in the same way."""
        return replace(self, recording=recording, signals=signals_of(recording, self.cutoff))


def suspicions_about(grasps: HandEye) -> tuple[str, ...]:
    """That poses do not fit together, in words."""
    turn, shift = float(np.degrees(grasps.noise[0])), grasps.noise[1]
    if turn < _LARGEST_TURN and shift < _LARGEST_SHIFT:
        return ()
    return (
        f"Poses differ by {turn:.2g}° and {1e3 * shift:.2g} mm from those of robots that hold one load. Are all clocks "
        f"alike, quaternions in the order qx qy qz qw, poses those of grasp frames in home frames that stand still? "
        f"Did all robots hold on all the time, and are they calibrated (--calibrate)?",
    )

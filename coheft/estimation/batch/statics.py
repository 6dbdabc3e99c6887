"""A load that is held still in several orientations, recorded separately from its motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.errors import RecordingError
from coheft.estimation.batch.holds import Holds, held_spans
from coheft.estimation.batch.recording import Recording, RobotRecord
from coheft.estimation.geometry.spatial import Array

_STILL = np.radians(2.0)
"""A load that rotates by more is not held still [rad]."""


@dataclass(frozen=True, eq=False)
class Statics:
    """Mean measurements of N robots in H holds.

    Attributes:
        names: Names of the robots.
        pose: Poses of grasp frames in home frames, as in ``RobotRecord``, shape (N, H, 7).
        wrench: ``(f, t)`` on the load, shape (N, H, 6).
        gravity: Gravity in the home frames, whose z axes are parallel, shape (3,) [m/s²].
    """

    names: tuple[str, ...]
    pose: Array
    wrench: Array
    gravity: Array

    @staticmethod
    def of_samples(recording: Recording, spans: Sequence[tuple[int, int]]) -> Statics:
        """Means of a recording's samples over holds, from first to one past last sample each."""
        pose, wrench = recording.stacked("pose"), recording.stacked("wrench")
        poses, wrenches = np.empty((len(pose), len(spans), 7)), np.empty((len(pose), len(spans), 6))
        for number, (start, end) in enumerate(spans, 1):
            wrenches[:, number - 1] = wrench[:, start:end].mean(axis=1)
            for own, means in zip(pose[:, start:end], poses[:, number - 1], strict=True):
                rotations = Rotation.from_quat(own[:, 3:])
                mean = rotations.mean()
                turn = float((mean.inv() * rotations).magnitude().max())
                if turn > _STILL:
                    raise RecordingError(
                        f"hold {number}, samples {start + 1} to {end}: the load turns by {np.degrees(turn):.2g}°, "
                        f"expected one that is held still, within {np.degrees(_STILL):g}°"
                    )
                means[:3], means[3:] = own[:, :3].mean(axis=0), mean.as_quat()
        return Statics(recording.names, poses, wrenches, recording.gravity)

    @staticmethod
    def of_recording(recording: Recording) -> Statics:
        """The holds of a recording: those that it names, or else those that are found."""
        spans = held_spans(recording)
        if not spans:
            raise RecordingError(
                f"the load is never held still from {recording.span}: expected forces that change by less than 0.5 N "
                f"for 6 s, or 'holds' that say when"
            )
        return Statics.of_samples(recording, spans)

    def of(self, names: Sequence[str]) -> Statics:
        """The same holds with the robots in this order."""
        if sorted(names) != sorted(self.names):
            raise RecordingError(f"found holds of {', '.join(self.names)}, expected those of {', '.join(names)}")
        order = [self.names.index(name) for name in names]
        return replace(self, names=tuple(names), pose=self.pose[order], wrench=self.wrench[order])

    def as_holds(self) -> Holds:
        """The same measurements with gravity in the grasp frames."""
        flat = Rotation.from_quat(self.pose[..., 3:].reshape(-1, 4))
        down = flat.inv().apply(self.gravity).reshape(*self.pose.shape[:2], 3)
        wrench = self.wrench.swapaxes(0, 1)
        return Holds(spans=(), down=down.swapaxes(0, 1), wrench=wrench, scatter=np.zeros_like(wrench))

    def as_recording(self) -> Recording:
        """A recording with one sample per hold; its times are the numbers of the holds."""
        time = np.arange(self.pose.shape[1], dtype=np.float64)
        samples = zip(self.names, self.pose, self.wrench, strict=True)
        robots = {name: RobotRecord(time, pose=pose, wrench=wrench) for name, pose, wrench in samples}
        return Recording(robots, gravity=self.gravity)

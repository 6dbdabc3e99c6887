"""Recordings of robots that hold a load together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from coheft.errors import RecordingError
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.rigid_body.mass_properties import Inertia

GRAVITY = (0.0, 0.0, -9.81)
CHANNELS = {
    "pose": ("x", "y", "z", "qx", "qy", "qz", "qw"),
    "twist": ("wx", "wy", "wz", "vx", "vy", "vz"),
    "dtwist": ("dwx", "dwy", "dwz", "dvx", "dvy", "dvz"),
    "acceleration": ("ax", "ay", "az"),
    "wrench": ("fx", "fy", "fz", "mx", "my", "mz"),
}
"""Attributes of ``RobotRecord`` that robots may record, and names of their columns."""
_TIME_TOLERANCE = 1e-3
"""Largest deviation of times from a regular grid, as a share of the sampling period."""
_UNIT = 1e-3
"""Largest difference of a unit quaternion's norm from one."""
_COARSE = 1e5
"""Times above this have steps of 8 ms and more as numbers of 32 bits [s]."""


@dataclass(frozen=True, eq=False)
class RobotRecord:
    """One robot's samples, all but the pose in its grasp frame ``F_i``; None if not recorded.

    Attributes:
        time: Times of the samples, shape (n,) [s].
        pose: Pose of ``F_i`` in the robot's home frame, ``x y z qx qy qz qw``, shape (n, 7).
        twist: ``(w, v)``, shape (n, 6).
        dtwist: Derivative of the twist's components ``(dw/dt, dv/dt)``, shape (n, 6).
        acceleration: Proper acceleration of the origin of ``F_i``, as accelerometers read it, shape (n, 3).
        wrench: ``(f, t)`` on the payload, shape (n, 6).
    """

    time: Array
    pose: Array | None = None
    twist: Array | None = None
    dtwist: Array | None = None
    acceleration: Array | None = None
    wrench: Array | None = None

    @property
    def channels(self) -> dict[str, Array]:
        """All that was recorded, by attribute, in the order of ``CHANNELS``."""
        return {name: samples for name in CHANNELS if (samples := getattr(self, name)) is not None}


@dataclass(frozen=True, eq=False)
class Truth:
    """The truth of a simulation, for comparison.

    Attributes:
        poses: Poses of all grasp frames in the first one.
        loads: The time from which on each load was held [s], and its inertia in the first grasp frame.
    """

    poses: tuple[Pose, ...]
    loads: tuple[tuple[float, Inertia], ...]

    def load_between(self, start: float, end: float) -> Inertia | None:
        """The load from start to end [s]; None if it changed meanwhile."""
        before = [inertia for since, inertia in self.loads if since <= start]
        return None if any(start < since < end for since, _ in self.loads) or not before else before[-1]


@dataclass(frozen=True, eq=False)
class Recording:
    """Simultaneous samples of a team.

    Attributes:
        robots: Records by robot; the first is the reference robot.
        gravity: Gravity in the home frames, whose z axes must be parallel, shape (3,) [m/s²].
        noise: White noise of the sensors; None if unknown.
        holds: Begin and end of each hold [s]; None if they have to be found.
        truth: The truth; None if unknown.
    """

    robots: Mapping[str, RobotRecord]
    gravity: Array = field(default_factory=lambda: np.array(GRAVITY))
    noise: SensorNoise | None = None
    holds: tuple[tuple[float, float], ...] | None = None
    truth: Truth | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The robots' names."""
        return tuple(self.robots)

    @property
    def time(self) -> Array:
        """Times of all samples, shape (n,) [s]."""
        return self.robots[self.names[0]].time

    @property
    def rate(self) -> float:
        """Samples per second."""
        return float((len(self.time) - 1) / (self.time[-1] - self.time[0]))

    def has(self, channel: str) -> bool:
        """Whether all robots recorded a channel."""
        return not self.without(channel)

    def without(self, channel: str) -> list[str]:
        """Names of the robots that did not record a channel."""
        return [name for name, robot in self.robots.items() if getattr(robot, channel) is None]

    def stacked(self, channel: str) -> Array:
        """One channel of all robots, shape (N, n, width)."""
        if missing := self.without(channel):
            raise RecordingError(f"'{channel}' of {', '.join(missing)} is missing, but needed")
        return np.array([getattr(robot, channel) for robot in self.robots.values()])

    def changed(self, channel: str, change: Callable[[Array], Array], name: str | None = None) -> Recording:
        """Change a channel, of shape (n, width), of one robot; None: of all robots."""
        robots = {
            own: replace(robot, **{channel: change(samples)}) if name in (None, own) else robot
            for (own, robot), samples in zip(self.robots.items(), self.stacked(channel), strict=True)
        }
        return replace(self, robots=robots)

    def between(self, start: float, end: float) -> Recording:
        """Only the samples between two times [s]."""
        kept = (self.time >= start) & (self.time <= end)
        if (found := np.count_nonzero(kept)) < 2:
            raise RecordingError(
                f"found {found} samples from {start:g} s to {end:g} s, expected at least 2: they are from {self.span}"
            )
        robots = {
            name: RobotRecord(robot.time[kept], **{c: samples[kept] for c, samples in robot.channels.items()})
            for name, robot in self.robots.items()
        }
        return replace(self, robots=robots)

    @property
    def span(self) -> str:
        """Begin and end, in words."""
        return f"{self.time[0]:g} s to {self.time[-1]:g} s"


def is_regular(times: Sequence[Array]) -> bool:
    """Whether all robots' times, shape (n,) each with n at least 2 [s], are the same regular ones."""
    steps = np.diff(times[0])
    return (
        len({len(time) for time in times}) == 1
        and all(np.ptp(np.diff(time)) <= 2.0 * _TIME_TOLERANCE * np.diff(time).mean() + 1e-9 for time in times)
        and all(np.abs(time - times[0]).max() <= _TIME_TOLERANCE * steps.mean() + 1e-9 for time in times)
    )


def check_recording(recording: Recording) -> None:
    """Check that all robots have valid samples at the same regular times."""
    if len(recording.robots) < 2:
        raise RecordingError(f"found {len(recording.robots)} robot, expected at least 2")
    for name, robot in recording.robots.items():
        if len(robot.time) < 2:
            raise RecordingError(f"'t' of {name}: found {len(robot.time)} samples, expected at least 2")
        falling = np.flatnonzero(np.diff(robot.time) <= 0.0)
        if len(falling):
            at = int(falling[0])
            raise RecordingError(
                f"'t' of {name}: sample {at + 2} is of {robot.time[at + 1]:.9g} s, the one before of "
                f"{robot.time[at]:.9g} s (in all, {len(falling)} are not later than the one before); expected times "
                f"that grow: {_advice(robot.time)}"
            )
        check_samples(name, robot)
    if not is_regular([robot.time for robot in recording.robots.values()]):
        raise RecordingError("times of robots differ, or have unequal steps: resample all at the same regular times")


def _advice(time: Array) -> str:
    """What to do about times that do not grow."""
    if np.array_equal(time, time.astype(np.float32)) and np.abs(time).max() > _COARSE:
        return "numbers of 32 bits have too few digits for such times; save them with 64 bits, or from zero on"
    return "sort the samples, and remove what is there twice"


def check_samples(name: str, robot: RobotRecord) -> None:
    """Check shapes and values of a robot's samples, but not their times."""
    for channel, samples in robot.channels.items():
        expected = len(robot.time), len(CHANNELS[channel])
        if samples.shape != expected:
            raise RecordingError(f"'{channel}' of {name}: found shape {samples.shape}, expected {expected}")
        if not np.isfinite(samples).all():
            bad = robot.time[~np.isfinite(samples).all(axis=1)]
            raise RecordingError(
                f"'{channel}' of {name}: not a finite number at {bad[0]:g} s (in all, in {len(bad)} samples); expected "
                f"numbers: leave these samples out, or keep a part without"
            )
    if robot.pose is None:
        return
    norms = np.linalg.norm(robot.pose[:, 3:], axis=1)
    off = np.flatnonzero(np.abs(norms - 1.0) > _UNIT)
    if len(off):
        raise RecordingError(
            f"'pose' of {name}: expected unit quaternions qx qy qz qw in the last four columns; {len(off)} of "
            f"{len(norms)} have another norm, the first at {robot.time[off[0]]:g} s, {norms[off[0]]:.4g}"
        )

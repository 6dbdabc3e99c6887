"""Sensors that do not work: they repeat a reading, or have nothing but noise."""

from __future__ import annotations

import numpy as np

from coheft.estimation.batch.judge.band import white_level
from coheft.estimation.batch.judge.cause import Cause
from coheft.estimation.batch.judge.verdict import Verdict
from coheft.estimation.batch.recording import Recording
from coheft.estimation.geometry.spatial import Array

_NOISE_ALONE = 1.5
"""Mean square of readings, in that of their noise, below which there is nothing else in them."""
_MOTIONS = {"pose": ("poses", 0.005), "twist": ("twists", 0.05), "acceleration": ("accelerations", 0.5)}
"""Words, and by how much another robot's first three columns have to change meanwhile [m, rad/s, m/s²]."""


def stuck_sensor(recording: Recording) -> Verdict | None:
    """A sensor whose readings are the same for more than a second: real ones have noise.

    Moments may be zero all the time: a hand in a gimbal has none. Encoders of a robot that stands still repeat
    themselves, but not while another robot moves.
    """
    found = _stuck_wrench(recording)
    return stuck_motion(recording) if found is None else _stuck(*found)


def stuck_motion(recording: Recording) -> Verdict | None:
    """A robot whose motion repeats itself while another one moves."""
    found = _stuck_motion(recording)
    return None if found is None else _stuck(*found)


def _stuck(name: str, what: str, start: float, seconds: float) -> Verdict:
    return _dead(
        name,
        start,
        f"{what} of {name} are exactly the same for {seconds:.1f} s from {start:.1f} s on: its sensor does not work, "
        f"or something repeats its last reading. --from and --to choose a part without that",
    )


def silent_sensor(recording: Recording, cutoff: float) -> Verdict | None:
    """A sensor whose forces are noise alone."""
    for name, wrench in zip(recording.names, recording.stacked("wrench"), strict=True):
        noise = white_level(wrench[:, :3], recording.rate, cutoff)
        if noise is not None and np.all(np.mean(wrench[:, :3] ** 2, axis=0) < _NOISE_ALONE * noise**2):
            return _dead(name, 0.0, f"forces of {name} are nothing but noise: its sensor does not work")
    return None


def _stuck_wrench(recording: Recording) -> tuple[str, str, float, float] | None:
    """Whose sensor repeats what, from when on [s], and for how long [s]."""
    for name, wrench in zip(recording.names, recording.stacked("wrench"), strict=True):
        for what, samples in (("forces", wrench[:, :3]), ("moments", wrench[:, 3:])):
            if what == "moments" and not samples.any():
                continue
            first, count = _longest_repeat(samples)
            if count > recording.rate:
                return name, what, float(recording.time[first]), count / recording.rate
    return None


def _stuck_motion(recording: Recording) -> tuple[str, str, float, float] | None:
    """Likewise, of what tells the motion."""
    for channel, (what, moved) in _MOTIONS.items():
        if not recording.has(channel):
            continue
        samples = recording.stacked(channel)
        for name, own in zip(recording.names, samples, strict=True):
            first, count = _longest_repeat(own)
            meanwhile = np.linalg.norm(np.ptp(samples[:, first : first + count, :3], axis=1), axis=1)
            if count > recording.rate and meanwhile.max() > moved:
                return name, what, float(recording.time[first]), count / recording.rate
    return None


def _longest_repeat(samples: Array) -> tuple[int, int]:
    """First index and number of the most samples (n, c) in a row that are the same."""
    same = np.all(np.diff(samples, axis=0) == 0.0, axis=1)
    changes = np.flatnonzero(np.concatenate([[True], ~same, [True]]))
    longest = int(np.argmax(np.diff(changes)))
    return int(changes[longest]), int(changes[longest + 1] - changes[longest])


def _dead(robot: str, start: float, words: str) -> Verdict:
    return Verdict(is_refuted=True, cause=Cause.DEAD, robot=robot, value=(start,), words=words)

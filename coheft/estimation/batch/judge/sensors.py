"""Sensors that do not work: they repeat a reading, lose samples, or return nothing but noise."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from coheft.estimation.batch.judge.band import white_level
from coheft.estimation.batch.judge.verdict import Cause, Verdict
from coheft.estimation.batch.recording import CHANNELS, Recording
from coheft.estimation.geometry.spatial import Array

_BRIEFLY, _UNLIKE = 0.2, 5.0
"""Time for which readings are the same [s], and this in multiples of the longest time elsewhere."""
_NOISE_ALONE = 2.5
"""Mean square of readings, in multiples of their noise's, below which they are nothing but noise."""
_SPIKE, _USUAL = 8.0, 0.1
"""Jumps of single samples, in multiples of the median second difference, at least this share of its deviation."""
_MATTERS = 0.001
"""Share of all forces that jumps have to make up."""
_FEWEST_AT_LIMIT, _AT_LIMIT, _NEIGHBOURS = 10, 5.0, 5
"""Samples at a limit, and these in multiples of those at each of the next values, beyond which it is no chance."""
_IN_TURN = 0.3
"""Share of the samples at a limit that follow another one there."""
AXES = CHANNELS["wrench"]
FORCES, MOMENTS = AXES[:3], AXES[3:]
_MOTIONS = (
    ("pose", slice(0, 7), "poses", 0.005),
    ("twist", slice(0, 3), "angular velocities", 0.05),
    ("twist", slice(3, 6), "velocities", 0.05),
    ("acceleration", slice(0, 3), "accelerations", 0.5),
)
"""Columns, and the least change of another robot's first three of them meanwhile [m, rad/s, m/s, m/s²]."""


def stuck_sensor(recording: Recording) -> Verdict | None:
    """Find a sensor whose readings are exactly the same for more than a second: real ones have noise.

    Moments may be zero all the time: a hand in a gimbal exerts none.
    """
    for name, wrench in _wrenches(recording):
        for what, samples in (("forces", wrench[:, :3]), ("moments", wrench[:, 3:])):
            first, count = _longest_repeat(samples)
            if count > recording.rate and (what == "forces" or samples.any()):
                return _stuck(recording, name, what, first, count)
    return None


def interrupted_sensor(recording: Recording) -> Verdict | None:
    """Find a sensor whose readings are the same for a shorter time, but far longer than they are elsewhere."""
    for name, wrench in _wrenches(recording):
        first, count = _longest_repeat(wrench[:, :3])
        elsewhere = max(_longest_repeat(part)[1] for part in (wrench[: first + 1, :3], wrench[first + count - 1 :, :3]))
        if count > max(_BRIEFLY * recording.rate, _UNLIKE * elsewhere):
            return _stuck(recording, name, "forces", first, count)
    return None


def stuck_motion(recording: Recording) -> Verdict | None:
    """Find a robot whose motion repeats itself while another one moves; encoders at rest may repeat themselves.

    Or one whose motion along some axes is exactly the same all the time; of robots in a plane, all are so.
    """
    for channel, columns, what, least in _MOTIONS:
        if not recording.has(channel):
            continue
        samples = recording.stacked(channel)[..., columns]
        for name, own in zip(recording.names, samples, strict=True):
            first, count = _longest_repeat(own)
            meanwhile = np.linalg.norm(np.ptp(samples[:, first : first + count, :3], axis=1), axis=1)
            if count > recording.rate and meanwhile.max() > least:
                return _stuck(recording, name, what, first, count)
    for channel in ("twist", "acceleration"):
        if recording.has(channel):
            constant = np.ptp(recording.stacked(channel), axis=1) == 0.0
            robots = np.flatnonzero(constant.any(axis=1))
            if len(robots) == 1:
                return _constant(recording.names[robots[0]], np.array(CHANNELS[channel])[constant[robots[0]]])
    return None


def spiking_sensor(recording: Recording) -> Verdict | None:
    """Find a sensor whose forces jump for single samples: zeros for lost ones, or disturbances."""
    for name, wrench in _wrenches(recording):
        forces = wrench[:, :3]
        before, after = np.diff(forces, axis=0)[:-1], -np.diff(forces, axis=0)[1:]
        usual = np.maximum(np.median(np.abs(before + after), axis=0), _USUAL * np.std(before + after, axis=0))
        usual = np.maximum(usual, np.min(np.abs(before), axis=0, initial=np.inf, where=before != 0.0))  # of one digit
        there_and_back = np.where(before * after > 0.0, np.minimum(np.abs(before), np.abs(after)), 0.0)
        sizes = np.where(there_and_back > _SPIKE * usual, there_and_back, 0.0).max(axis=1)
        if sizes.sum() < _MATTERS * np.linalg.norm(forces, axis=1).sum():
            continue
        limited = saturated_sensor(recording)
        if limited is not None and limited.robot == name:
            return limited
        worst = int(np.argmax(sizes))
        since = float(recording.time[worst + 1])
        words = (
            f"forces of {name} jump for single samples, {np.count_nonzero(sizes)} times, most at {since:.2f} s, by "
            f"{sizes[worst]:.3g} N: lost samples that are given as zero, or disturbances? Leave these samples out"
        )
        return _dead(name, words, since)
    return None


def saturated_sensor(recording: Recording, share: float = 0.0) -> Verdict | None:
    """Find a sensor whose readings stay at their largest or smallest value, for more than this share of the time.

    Next to this value there are far fewer samples, also of coarse or repeated readings.
    """
    for name, wrench in _wrenches(recording):
        found = [
            (f"{axis} at {level:.4g} {'N' if axis in FORCES else 'N·m'}", count)
            for axis, readings in zip(AXES, wrench.T, strict=True)
            for level, count in _limits(readings)
        ]
        most = max((count for _, count in found), default=0)
        if most > share * len(wrench):
            limits = ", ".join(limit for limit, _ in found)
            words = (
                f"readings of {name} stay at their largest or smallest value, {limits}, up to {most} samples: its "
                f"sensor is saturated. Choose a part without this with --from and --to, or a larger range"
            )
            return _dead(name, words)
    return None


def _limits(readings: Array) -> Iterator[tuple[float, int]]:
    """Limits at which readings (n,) stay, and for how many samples."""
    levels, counts = np.unique(readings, return_counts=True)
    for own, near in ((0, counts[1 : 1 + _NEIGHBOURS]), (-1, counts[-1 - _NEIGHBOURS : -1])):
        count = int(counts[own])
        is_there = readings == levels[own]
        in_turn = np.count_nonzero(is_there[1:] & is_there[:-1])  # single samples jump there
        if (
            len(near) == _NEIGHBOURS
            and levels[own] != 0.0
            and count > max(_FEWEST_AT_LIMIT, _AT_LIMIT * near.max())
            and in_turn > _IN_TURN * count
        ):
            yield float(levels[own]), count


def silent_sensor(recording: Recording, cutoff: float, *, is_whole: bool) -> Verdict | None:
    """Find a sensor whose forces, or unless ``is_whole`` those of some axes, are nothing but noise."""
    for name, wrench in _wrenches(recording):
        noise = white_level(wrench[:, :3], recording.rate, cutoff)
        if noise is None:
            continue
        silent = np.mean(wrench[:, :3] ** 2, axis=0) < _NOISE_ALONE * noise**2
        if silent.all():
            return _dead(
                name, f"forces of {name} are nothing but noise: its sensor does not work, or it does not hold the load"
            )
        if silent.any() and not is_whole:
            axes = ", ".join(np.array(FORCES)[silent])
            return _dead(name, f"{axes} of {name} is nothing but noise: does its sensor work?")
    return None


def missing_axis(recording: Recording, axes: Sequence[str]) -> Verdict | None:
    """Find a sensor whose readings along some of these axes (``fx``, …) are the same all the time."""
    for name, wrench in _wrenches(recording):
        missing = [axis for axis in axes if np.ptp(wrench[:, AXES.index(axis)]) == 0.0]
        if missing:
            return _constant(name, missing)
    return None


def _wrenches(recording: Recording) -> Iterator[tuple[str, Array]]:
    """Robots and their wrenches, shape (n, 6)."""
    return zip(recording.names, recording.stacked("wrench"), strict=True)


def _dead(name: str, words: str, since: float = 0.0) -> Verdict:
    return Verdict(Cause.DEAD, name, (since,), words)


def _constant(name: str, axes: Iterable[str]) -> Verdict:
    return _dead(name, f"{', '.join(axes)} of {name} are exactly the same all the time: were they measured?")


def _stuck(recording: Recording, name: str, what: str, first: int, count: int) -> Verdict:
    start = float(recording.time[first])
    words = (
        f"{what} of {name} are exactly the same for {count / recording.rate:.1f} s from {start:.1f} s on: its sensor "
        f"does not work, or something repeats its last reading. Choose a part without this with --from and --to"
    )
    return _dead(name, words, start)


def _longest_repeat(samples: Array) -> tuple[int, int]:
    """First index and number of the longest run of equal samples (n, c)."""
    same = np.all(np.diff(samples, axis=0) == 0.0, axis=1)
    changes = np.flatnonzero(np.concatenate([[True], ~same, [True]]))
    longest = int(np.argmax(np.diff(changes)))
    return int(changes[longest]), int(changes[longest + 1] - changes[longest])

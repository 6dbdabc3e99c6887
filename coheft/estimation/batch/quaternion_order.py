"""Quaternions with their real part first, where it is expected last.

Taken for the other order, each orientation is the inverse of the right one, but for constant rotations before and after
it. All of them still turn together, as those of one load; but positions do not move as these turn.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from coheft.errors import RecordingError
from coheft.estimation.batch.pairs import kabsch, position_between
from coheft.estimation.batch.recording import Recording
from coheft.estimation.batch.signals import signals_of
from coheft.estimation.geometry.spatial import Array

_MISFIT = 0.3
"""Share of the velocities that may be unexplained without a doubt about the order."""
_BETTER = 3.0
"""So many times less must be unexplained with another order to call it the right one."""


def check_quaternions(recording: Recording, cutoff: float) -> None:
    """Check that no other order of the quaternions explains the robots' motions far better.

    Args:
        recording: With poses.
        cutoff: Of the filter [Hz].

    Raises:
        RecordingError: Real parts seem to be first; says whose. Or the recording is too short.
    """
    given = _twists(recording, cutoff)
    found = _misfit(given)
    if found < _MISFIT:
        return
    turned = _twists(_with_last_first(recording), cutoff)
    count = len(given)
    choices = [np.ones(count, dtype=np.bool_), *np.eye(count, dtype=np.bool_)]
    misfits = [_misfit(np.where(choice[:, None, None], turned, given)) for choice in choices]
    best = int(np.argmin(misfits))
    if misfits[best] * _BETTER < found:
        names = ", ".join(name for name, is_turned in zip(recording.names, choices[best], strict=True) if is_turned)
        raise RecordingError(
            f"'pose' of {names}: with quaternions qx qy qz qw as expected, robots that hold one load cannot move like "
            f"this; as qw qx qy qz they can. Move the real part to the end"
        )


def _twists(recording: Recording, cutoff: float) -> Array:
    """Twists that follow from poses alone, shape (N, n, 6)."""
    robots = {name: replace(robot, twist=None, dtwist=None) for name, robot in recording.robots.items()}
    signals = signals_of(replace(recording, robots=robots), cutoff)
    return np.concatenate([signals.w, signals.v], axis=-1)


def _with_last_first(recording: Recording) -> Recording:
    """Quaternions taken as ``qw qx qy qz``, and put into the order ``qx qy qz qw``."""
    robots = {}
    for name, robot in recording.robots.items():
        if robot.pose is None:
            raise ValueError(f"expected poses of {name}")
        robots[name] = replace(robot, pose=robot.pose[:, [0, 1, 2, 4, 5, 6, 3]])
    return replace(recording, robots=robots)


def _misfit(twists: Array) -> float:
    """Share of the velocities that no fixed grasps explain, of the worst robot beside the first."""
    w, v = twists[0, :, :3], twists[0, :, 3:]
    shares = []
    for other in twists[1:]:
        rotation = kabsch(w, other[:, :3])
        position = position_between(rotation, w, v, other[:, 3:], w)
        left = v - other[:, 3:] @ rotation.T - np.cross(position, w)
        size = np.sum(v**2) + np.sum(other[:, 3:] ** 2)
        shares.append(float(np.sqrt(2.0 * np.sum(left**2) / max(size, np.finfo(np.float64).tiny))))
    return max(shares)

"""Checks for poses in another convention: another order of the quaternions, inverse poses, or other axes.

Quaternions with the real part first, read in the other order, are the inverses of the right ones up to constant
rotations: the robots still turn together, but positions do not move accordingly. The same holds if one robot's poses,
or only its quaternions, are inverse. If all robots' poses are inverse, only forces tell (``judged``).
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import permutations, product

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.errors import RecordingError
from coheft.estimation.batch.pairs import kabsch, position_between
from coheft.estimation.batch.recording import Recording
from coheft.estimation.batch.signals import Signals, signals_of
from coheft.estimation.geometry.spatial import Array

_MISFIT = 0.3
"""Share of the velocities that may remain unexplained."""
_BETTER = 3.0
"""Factor by which another convention has to reduce the unexplained share."""
_EXPLAINED = 0.15
"""Largest share that another convention may leave unexplained."""
_GOOD = 0.05
"""Choices that leave less are equivalent: either of two robots may have inverse poses."""


def inverse_poses(poses: Array) -> Array:
    """Inverses of poses ``x y z qx qy qz qw``, shape (n, 7)."""
    back = Rotation.from_quat(poses[:, 3:]).inv()
    return np.hstack([-back.apply(poses[:, :3]), back.as_quat()])


def _other_axes() -> Iterator[tuple[Callable[[Array], Array], str, str]]:
    """Positions whose axes are exchanged, or have other signs."""
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        if order == (0, 1, 2) and min(signs) > 0.0:
            continue
        names = " ".join(f"{'-' if sign < 0.0 else ''}{'xyz'[axis]}" for axis, sign in zip(order, signs, strict=True))
        convert = partial(_rearranged, columns=[*order, 3, 4, 5, 6], signs=[*signs, 1.0, 1.0, 1.0, 1.0])
        yield convert, f"with positions {names} in place of x y z", "Exchange the columns, or change their signs"


def _rearranged(poses: Array, columns: list[int], signs: list[float]) -> Array:
    return poses[:, columns] * signs


_REAL_PART_LAST = partial(_rearranged, columns=[0, 1, 2, 4, 5, 6, 3], signs=[1.0] * 7)
_INVERSE_QUATERNIONS = partial(_rearranged, columns=list(range(7)), signs=[1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 1.0])
_CONVENTIONS: tuple[tuple[Callable[[Array], Array], str, str], ...] = (
    (_REAL_PART_LAST, "with quaternions in the order qw qx qy qz", "Move the real part to the end"),
    (inverse_poses, "as inverses, poses of the home frame in the grasp frame,", "Invert them"),
    (_INVERSE_QUATERNIONS, "with inverse quaternions", "Change the signs of qx qy qz"),
)
"""Conversions from other conventions, with words for the convention and the remedy."""


def check_conventions(recording: Recording, cutoff: float, signals: Signals) -> None:
    """Check that no other convention explains the robots' motions far better.

    Args:
        recording: The recording, with poses.
        cutoff: Cutoff of the filter [Hz].
        signals: Signals of the recording.

    Raises:
        RecordingError: Another convention does; the message says which, and whose poses have it.
    """
    given = _twists(recording, cutoff) if recording.has("twist") else _twists_of(signals)
    found = _misfit(given)
    if found < _MISFIT:
        return
    count = len(given)
    choices = [np.ones(count, dtype=np.bool_), *np.eye(count, dtype=np.bool_)]
    for conventions in (_CONVENTIONS, tuple(_other_axes())):  # mirrored positions of few robots may fit as well
        tried = []
        for convert, how, what_to_do in conventions:
            other = _twists(recording.changed("pose", convert), cutoff)
            tried += [
                (_misfit(np.where(choice[:, None, None], other, given)), choice, how, what_to_do) for choice in choices
            ]
        least, _, how, what_to_do = min(tried, key=lambda one: one[0])
        if least * _BETTER <= found and least <= _EXPLAINED:
            break
    else:
        return
    alike = [choice for misfit, choice, words, _ in tried if words == how and misfit < max(_GOOD, _BETTER * least)]
    names = ", or of ".join(
        ", ".join(name for name, is_other in zip(recording.names, choice, strict=True) if is_other) for choice in alike
    )
    raise RecordingError(
        f"'pose' of {names}: as poses of the grasp frame in the home frame with quaternions qx qy qz qw, as expected, "
        f"robots that hold one load cannot move like this; {how} they can. {what_to_do}"
    )


def _twists(recording: Recording, cutoff: float) -> Array:
    """Twists from poses only, shape (N, n, 6)."""
    robots = {name: replace(robot, twist=None, dtwist=None) for name, robot in recording.robots.items()}
    return _twists_of(signals_of(replace(recording, robots=robots), cutoff))


def _twists_of(signals: Signals) -> Array:
    return np.concatenate([signals.w, signals.v], axis=-1)


def _misfit(twists: Array) -> float:
    """Share of the velocities that no fixed grasps explain, largest over the robots after the first."""
    w, v = twists[0, :, :3], twists[0, :, 3:]
    shares = []
    for other in twists[1:]:
        rotation = kabsch(w, other[:, :3])
        position = position_between(rotation, w, v, other[:, 3:], w)
        left = v - other[:, 3:] @ rotation.T - np.cross(position, w)
        size = np.sum(v**2) + np.sum(other[:, 3:] ** 2)
        shares.append(float(np.sqrt(2.0 * np.sum(left**2) / max(size, np.finfo(np.float64).tiny))))
    return max(shares)

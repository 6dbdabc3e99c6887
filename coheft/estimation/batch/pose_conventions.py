"""Checks for poses in another convention: another order of the quaternions, inverse poses, or other axes.

Quaternions with the real part first, read in the other order, are the inverses of the right ones up to constant
rotations: the robots still turn together, but positions do not move accordingly. The same holds if one robot's poses,
or only its quaternions, are inverse. If all robots' poses are inverse, only forces tell (``judged``).
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
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
_FINEST = 1e-6
"""Velocities below this are rounding [m/s]."""
_STARTS, _PASSES = (0.0, 0.5 * np.pi, np.pi, -0.5 * np.pi), 4
_TURNS_FIRST = 10.0
"""Weight of angular velocities against velocities when rotations between grasps are fitted [m]."""
_GOOD = 0.05
"""Choices that leave less are equivalent: either of two robots may have inverse poses."""


def inverse_poses(poses: Array) -> Array:
    """Inverses of poses ``x y z qx qy qz qw``, shape (n, 7)."""
    back = Rotation.from_quat(poses[:, 3:]).inv()
    return np.hstack([-back.apply(poses[:, :3]), back.as_quat()])


def turned_poses(poses: Array, turn: Rotation) -> Array:
    """Poses ``x y z qx qy qz qw``, shape (n, 7), in a home frame that is rotated."""
    return np.hstack([turn.apply(poses[:, :3]), (turn * Rotation.from_quat(poses[:, 3:])).as_quat()])


_CONVENTIONS: tuple[tuple[Callable[[Array], Array], str, str], ...] = (
    (
        lambda p: p[:, [0, 1, 2, 4, 5, 6, 3]],
        "with quaternions in the order qw qx qy qz",
        "Move the real part to the end",
    ),
    (inverse_poses, "as inverses, poses of the home frame in the grasp frame,", "Invert them"),
    (lambda p: p * [1, 1, 1, -1, -1, -1, 1], "with inverse quaternions", "Change the signs of qx qy qz"),
)
"""Conversions from other conventions, with words for the convention and the remedy."""


def check_conventions(recording: Recording, cutoff: float, signals: Signals) -> None:
    """Check that no other convention of poses explains the robots' motions far better."""
    by_poses = _by_poses(recording, cutoff) if recording.has("twist") else signals
    given = by_poses.twists
    found = _misfit(given)
    if found < _MISFIT:
        return
    count = len(given)
    choices = [np.ones(count, dtype=np.bool_), *np.eye(count, dtype=np.bool_)]
    # Mirrored positions of few robots may fit as well as other conventions.
    for conventions in (_other_conventions(recording, cutoff), _other_axes(by_poses)):
        tried = [
            (_misfit(np.where(choice[:, None, None], other, given)), choice, how, what_to_do)
            for other, how, what_to_do in conventions
            for choice in choices
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


def _other_conventions(recording: Recording, cutoff: float) -> Iterator[tuple[Array, str, str]]:
    """Twists (N, n, 6) of poses in other conventions, with words for the convention and the remedy."""
    for convert, how, what_to_do in _CONVENTIONS:
        yield _by_poses(recording.changed("pose", convert), cutoff).twists, how, what_to_do


def _other_axes(signals: Signals) -> Iterator[tuple[Array, str, str]]:
    """The same of positions whose axes are exchanged, or have other signs."""
    assert signals.rotation is not None
    in_home = (signals.rotation @ signals.v[..., None])[..., 0]
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        if order == (0, 1, 2) and min(signs) > 0.0:
            continue
        names = " ".join(f"{'-' if sign < 0.0 else ''}{'xyz'[axis]}" for axis, sign in zip(order, signs, strict=True))
        v = ((in_home[..., list(order)] * signs)[..., None, :] @ signals.rotation)[..., 0, :]
        how = f"with positions {names} in place of x y z"
        yield np.concatenate([signals.w, v], axis=-1), how, "Exchange the columns, or change their signs"


def _by_poses(recording: Recording, cutoff: float) -> Signals:
    """Signals with twists from poses only."""
    robots = {name: replace(robot, twist=None, dtwist=None) for name, robot in recording.robots.items()}
    return signals_of(replace(recording, robots=robots), cutoff)


def _misfit(twists: Array) -> float:
    """Share of the velocities that no fixed grasps explain, largest over the robots after the first."""
    return max(_misfit_of_two(twists[0], other) for other in twists[1:])


def _misfit_of_two(one: Array, other: Array) -> float:
    """The same of two robots' twists (n, 6).

    What a load that turns about one axis, or not at all, leaves open of the rotation between the grasps, its velocities
    tell.
    """
    (w, v), (w_other, v_other) = np.hsplit(one, 2), np.hsplit(other, 2)
    size = max(float(np.sum(v**2) + np.sum(v_other**2)), len(v) * _FINEST**2)
    axis, least = np.linalg.svd(w_other.T @ w_other)[0][:, 0], np.inf
    for turn in _STARTS:
        rotation = kabsch(w, w_other) @ Rotation.from_rotvec(turn * axis).as_matrix()
        for _ in range(_PASSES):
            position = position_between(rotation, w, v, v_other, w)
            by_arm = np.cross(position, w)
            least = min(least, float(np.sum((v - v_other @ rotation.T - by_arm) ** 2)))
            rotation = kabsch(np.vstack([_TURNS_FIRST * w, v - by_arm]), np.vstack([_TURNS_FIRST * w_other, v_other]))
        if 2.0 * least < _MISFIT**2 * size:
            break
    return float(np.sqrt(2.0 * least / size))

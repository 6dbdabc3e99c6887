"""Checks for recordings in other units, orders, signs or conventions of poses than expected."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import combinations, permutations, product

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.errors import RecordingError
from coheft.estimation.batch.pairs import kabsch, position_between
from coheft.estimation.batch.pose_rates import check_rates
from coheft.estimation.batch.recording import Recording, check_recording
from coheft.estimation.batch.signals import Signals, signals_of, turns
from coheft.estimation.geometry.body_motion import BODY_A, BODY_V, BODY_W
from coheft.estimation.geometry.spatial import Array

_FASTEST = 5.0
"""No load moves faster than this for a tenth of the time [m/s]."""
_FASTEST_TURN = 10.0
"""No load turns faster than this for a tenth of the time [rad/s]."""
_JUMP_SPAN = 0.02
"""Time over which jumps are measured, at least one sample [s]: noise of 2° or 3 cm is no jump."""
_JUMP_TURN, _JUMP_SPEED = 20.0, 10.0
"""Poses that change faster jump [rad/s, m/s]: no filter across a jump tells how the load moved."""
_SHARE = 0.9
_STEP = 0.1
"""Time over which velocities are measured or averaged [s]."""
_LEAST_GRAVITY, _MOST_GRAVITY = 0.5, 2.0
"""Range of the median acceleration, in multiples of gravity."""
_OPPOSITE = 0.05
"""Share of all forces by which their sum may point downwards: scales of sensors differ by less."""
_SLOWEST = 0.02
"""Root mean square below which velocities may be nothing but noise [rad/s, m/s]."""
_ALIKE = 0.3
"""Largest ratio of the differences between robots with another order of twists to those with the expected one."""
_STEADY = 0.3
"""Largest relative variation of the upward force while a load is moved."""
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


def plausible_signals(recording: Recording, cutoff: float) -> Signals:
    """Check shapes, units, order and signs of a recording, and return its smooth signals."""
    check_plausible(recording)
    signals = signals_of(recording, cutoff)
    if recording.has("pose"):
        check_conventions(recording, cutoff, signals)
    check_weight(recording, signals.wrench, signals.motion[..., BODY_A])
    return signals


def check_plausible(recording: Recording) -> None:
    """Check shapes, units and order of a recording's samples."""
    check_recording(recording)
    _check_robots(recording)
    check_units(recording)
    check_twists(recording)
    _check_jumps(recording)


def _check_robots(recording: Recording) -> None:
    """Check that no robot is there twice; made-up ones at rest may be equal."""
    for (one, own), (other, others) in combinations(recording.robots.items(), 2):
        is_same = own.channels.keys() == others.channels.keys() and all(
            np.array_equal(samples, others.channels[channel]) for channel, samples in own.channels.items()
        )
        steps = (np.abs(np.diff(samples, axis=0)).max(axis=1) for samples in own.channels.values())
        if is_same and any(np.median(step) > 0.0 for step in steps):
            raise RecordingError(
                f"{one} and {other} recorded exactly the same: expected two robots, not one file twice"
            )


def check_units(recording: Recording) -> None:
    """Check that nothing moves faster than loads are carried, and that accelerations are about that of gravity."""
    steps = max(1, round(_STEP * recording.rate))
    expected = float(np.linalg.norm(recording.gravity))
    for name, robot in recording.robots.items():
        if robot.pose is not None and len(robot.pose) > steps:
            places = robot.pose[:, :3]
            _check_speed("pose", name, (places[steps:] - places[:-steps]) * recording.rate / steps)
        if robot.twist is not None:
            _check_speed("twist", name, robot.twist[:, 3:])
            found = float(np.quantile(np.linalg.norm(robot.twist[:, :3], axis=1), _SHARE))
            if found > _FASTEST_TURN:
                raise RecordingError(
                    f"'twist' of {name} turns at {found:.3g} rad/s, expected less than {_FASTEST_TURN:g} rad/s: are "
                    f"its angular velocities in degrees per second? Give them in rad/s"
                )
        if robot.acceleration is not None and expected > 0.0:
            found = float(np.median(np.linalg.norm(robot.acceleration, axis=1)))
            if not _LEAST_GRAVITY * expected <= found <= _MOST_GRAVITY * expected:
                raise RecordingError(
                    f"'acceleration' of {name} is {found:.3g} m/s² half of the time, expected about {expected:.3g}, "
                    f"which is gravity: give what an accelerometer reads, acceleration minus gravity, in m/s²"
                )


def _check_speed(channel: str, name: str, velocities: Array) -> None:
    found = float(np.quantile(np.linalg.norm(velocities, axis=1), _SHARE))
    if found > _FASTEST:
        raise RecordingError(
            f"'{channel}' of {name} moves at {found:.3g} m/s, expected less than {_FASTEST:g} m/s: are its lengths in "
            f"another unit, as millimetres? Give them in metres"
        )


def check_twists(recording: Recording) -> None:
    """Check that the first three columns of twists, and not the last, may be angular velocities of one load.

    Robots that hold one load turn equally fast, but their hands move at different velocities.
    """
    if not recording.has("twist"):
        return
    steps = max(1, round(_STEP * recording.rate))
    twists = recording.stacked("twist")
    count = twists.shape[1] // steps
    means = twists[:, : count * steps].reshape(len(twists), count, steps, 6).mean(axis=2)
    speeds = np.linalg.norm(means.reshape(len(twists), count, 2, 3), axis=-1)  # of both halves
    if np.sqrt(np.mean(speeds**2, axis=1)).min() < _SLOWEST:
        return
    robots = np.arange(len(twists))
    orders = [np.zeros_like(robots), np.ones_like(robots), *np.eye(len(robots), dtype=robots.dtype)]
    angular = [speeds[robots, :, halves] for halves in orders]
    apart = [np.sqrt(np.mean((sizes - sizes.mean(axis=0)) ** 2) / np.mean(sizes**2)) for sizes in angular]
    best = int(np.argmin(apart))
    if best == 0 or apart[best] > _ALIKE * apart[0]:
        return
    wrong = ", ".join(name for name, half in zip(recording.names, orders[best], strict=True) if half)
    raise RecordingError(
        f"'twist' of {wrong}: robots that hold one load turn equally fast, but only with the last three columns as "
        f"angular velocities these do. Give the angular velocity first, wx wy wz vx vy vz"
    )


def _check_jumps(recording: Recording) -> None:
    """Check that no robot's pose jumps: trackers lose sight, and logs have gaps or are joined."""
    steps = max(1, round(_JUMP_SPAN * recording.rate))
    seconds = steps / recording.rate
    for name, robot in recording.robots.items():
        if robot.pose is None:
            continue
        before, after = robot.pose[:-steps], robot.pose[steps:]
        turn = turns(before, after)
        shift = np.linalg.norm(after[:, :3] - before[:, :3], axis=1)
        is_jump = (turn > _JUMP_TURN * seconds) | (shift > _JUMP_SPEED * seconds)
        if is_jump.any():
            first = int(np.argmax(is_jump))
            raise RecordingError(
                f"'pose' of {name} jumps at {robot.time[first + steps]:g} s, by {np.degrees(turn[first]):.3g}° and "
                f"{shift[first]:.3g} m within {seconds:g} s: choose a part without jumps with --from and --to. If it "
                f"jumps all the time, are times in seconds, positions in metres, and quaternions in the order "
                f"qx qy qz qw?"
            )


def check_weight(recording: Recording, wrench: Array, acceleration: Array) -> None:
    """Check that the forces carry the load: along the accelerations they add up to a positive mass.

    Internal forces, by which robots push against each other, cancel. Wrenches ``(f, t)``, shape (N, n, 6), and proper
    accelerations of the frames' origins, (N, n, 3), are in the grasp frames.
    """
    strength = float(np.sqrt(np.mean(np.square(acceleration).sum(axis=-1))))
    if strength == 0.0:
        raise RecordingError("the load neither accelerates nor feels gravity, so nothing shows its mass")
    force, force_size, is_force_steady = _lift(wrench[..., :3], acceleration, strength)
    moment, moment_size, is_moment_steady = _lift(wrench[..., 3:], acceleration, strength)
    found = f"wrenches add up to {force / strength:.3g} kg"
    is_larger = moment > abs(force) and moment_size > force_size  # lever arms are shorter than a metre
    if is_larger and is_moment_steady and not is_force_steady:
        raise RecordingError(
            f"{found}, but what is given as moments would be forces that carry {moment / strength:.3g} kg: give "
            f"the moment first, mx my mz fx fy fz"
        )
    if force_size == 0.0:
        raise RecordingError(f"{found}: all forces are zero, so nothing shows the mass. Record the force of every hand")
    if force > -_OPPOSITE * force_size:
        return
    gravity = "accelerations must be what accelerometers read, acceleration minus gravity"
    if not recording.has("acceleration"):
        x, y, z = recording.gravity
        gravity = f"gravity in the home frames, ({x:g}, {y:g}, {z:g}), must point down"
    raise RecordingError(
        f"{found}: they must be what the robots do to the load, not what it does to them, in the axes of the grasp "
        f"frames. Turn their signs; or, if they are right, {gravity}"
    )


def _lift(vectors: Array, acceleration: Array, strength: float) -> tuple[float, float, bool]:
    """Component of the sum of all robots' vectors (N, n, 3) along their proper accelerations, in root mean square size.

    Returns:
        Its mean over time; the sum of the root mean square sizes of the robots' vectors; whether it is positive and
        nearly constant, as the weight of a load is.
    """
    along = np.einsum("ikx,ikx->k", vectors, acceleration) / strength
    size = np.sqrt(np.square(vectors).sum(axis=-1).mean(axis=1)).sum()
    mean = float(along.mean())
    return mean, float(size), mean > 0.0 and float(along.std()) < _STEADY * mean


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
    """Check that no other convention of poses explains the robots' motions far better.

    Quaternions with the real part first, read in the other order, are the inverses of the right ones up to constant
    rotations: the robots still turn together, but positions do not move accordingly. The same holds if one robot's
    poses, or only its quaternions, are inverse. If all robots' poses are inverse, only forces tell (``judged``).
    """
    by_poses = _by_poses(recording, cutoff) if recording.has("twist") else signals
    check_rates(recording.names, signals, by_poses)
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
    w, velocity = signals.motion[..., BODY_W], signals.motion[..., BODY_V]
    in_home = (signals.rotation @ velocity[..., None])[..., 0]
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        if order == (0, 1, 2) and min(signs) > 0.0:
            continue
        names = " ".join(f"{'-' if sign < 0.0 else ''}{'xyz'[axis]}" for axis, sign in zip(order, signs, strict=True))
        v = ((in_home[..., list(order)] * signs)[..., None, :] @ signals.rotation)[..., 0, :]
        how = f"with positions {names} in place of x y z"
        yield np.concatenate([w, v], axis=-1), how, "Exchange the columns, or change their signs"


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

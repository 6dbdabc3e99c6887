"""Motion of a grasp frame when the load moves as a rigid body."""

from dataclasses import dataclass

import numpy as np

from coheft.estimation.geometry.spatial import Array, Pose, rotation_coefficients


@dataclass(frozen=True, eq=False)
class CarriedMotion:
    """Motion of ``F_i`` relative to its home frame, in the axes of the home frame.

    Attributes:
        rotation: Rotation vector, shape (n, 3) [rad].
        position: Position of the origin, shape (n, 3) [m].
        rotation_rate: Rate of the rotation vector, shape (n, 3) [rad/s].
        velocity: Velocity of the origin, shape (n, 3) [m/s].
        w: Angular velocity, shape (n, 3) [rad/s].
    """

    rotation: Array
    position: Array
    rotation_rate: Array
    velocity: Array
    w: Array


def carried_motion(displacement: Array, rate: Array, pose_i_in_ref: Pose) -> CarriedMotion:
    """Return the motion of ``F_i`` on a body whose frame ``F_ref`` moves away from its home.

    With the displacement ``D`` of ``F_ref`` in its home frame and the constant pose ``X`` of ``F_i`` in ``F_ref``,
    ``F_i`` is displaced by ``X^-1 D X`` in its own home frame.

    Args:
        displacement: Displacement of ``F_ref`` in its home frame: rotation vector [rad], position [m], shape (n, 6).
        rate: Rates of both, shape (n, 6).
        pose_i_in_ref: ``X``.
    """
    turn, shift = displacement[:, :3], displacement[:, 3:]
    turn_rate, shift_rate = rate[:, :3], rate[:, 3:]
    to_home = pose_i_in_ref.rotation
    once, twice, thrice = rotation_coefficients(turn)
    arm = pose_i_in_ref.translation
    cross = np.cross(turn, arm)
    turned = arm + once * cross + twice * np.cross(turn, cross)
    rate_cross = np.cross(turn, turn_rate)
    w = turn_rate + twice * rate_cross + thrice * np.cross(turn, rate_cross)
    return CarriedMotion(
        rotation=turn @ to_home,
        position=(turned + shift - arm) @ to_home,
        rotation_rate=turn_rate @ to_home,
        velocity=(np.cross(w, turned) + shift_rate) @ to_home,
        w=w @ to_home,
    )

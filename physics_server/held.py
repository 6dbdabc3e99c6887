"""Checks that end a simulation: controls that the engine cannot use, and a payload that the robots have lost."""

import math
from collections.abc import Iterable, Sequence

import mujoco
import numpy as np

from coheft.errors import SimulationError
from coheft.estimation.geometry.spatial import Array
from coheft.physics_server.scene import PAYLOAD_HOME
from coheft.wire.messages.codec import is_finite
from coheft.wire.scenario.schema import PHYSICS_RATE
from coheft.wire.scenario.strength import MAX_ANGLE, MAX_DISTANCE


def check_controls(controls: Array, pushed: Array, names: Sequence[str], time: float) -> None:
    """Check that controls are finite and below the engine's limit; the engine itself would release all arms silently.

    Args:
        controls: Controls of the springs of N arms, shape (steps, 6 N).
        pushed: Feed-forward wrenches of the arms, shape (N, 6).
        names: The robots' names.
        time: Start of the block [s], for the ``SimulationError``.
    """
    if max(np.abs(controls).max(), np.abs(pushed).max()) < mujoco.mjMAXVAL:
        return
    springs = np.abs(controls).reshape(len(controls), len(names), 6).max(axis=(0, 2))
    largest = np.maximum(springs, np.abs(pushed).max(axis=1))
    bad = [name for name, value in zip(names, largest, strict=True) if not value < mujoco.mjMAXVAL]
    raise SimulationError(
        f"at {time:.3f} s references of {', '.join(bad)} contain numbers that are not finite or not below "
        f"{mujoco.mjMAXVAL:g}"
    )


def check_held(position: Array, others: Iterable[Array], time: float) -> None:
    """Check that the robots still hold the payload.

    Args:
        position: Position [m] and quaternion of the payload, shape (7,).
        others: Other arrays that have to be finite.
        time: End of the block [s], for the ``SimulationError``.
    """
    distance = math.dist(position[:3], PAYLOAD_HOME.translation)
    angle = 2.0 * math.atan2(math.hypot(*position[4:]), abs(position[3]))
    if not all(map(is_finite, (position, *others))):
        found = "its motion is no longer finite"
    elif distance > MAX_DISTANCE or angle > MAX_ANGLE:
        found = f"it is {distance:.1f} m from its home and rotated by {math.degrees(angle):.0f} degrees"
    else:
        return
    raise SimulationError(
        f"at {time:.3f} s the robots have lost the payload: {found}. Likely causes: references that are too large or "
        f"contradict each other, a load too heavy or too far out, or too much damping for so light a payload at "
        f"{PHYSICS_RATE} steps per second"
    )

"""Check that arms can hold the loads on them: under a weight their springs give way, so that the payload sinks and
tilts.

Grams instead of kilograms are a common mistake, and a run with them is lost within a second. Loads that are refused
here would certainly be lost; others may still be lost, depending on the motion.
"""

import math
from collections.abc import Callable, Sequence
from typing import Self

import numpy as np

from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp, rotation_log, skew
from coheft.estimation.rigid_body.mass_properties import Inertia, combined
from coheft.wire.scenario.rules import rounded_down
from coheft.wire.scenario.schema import Robots

MAX_DISTANCE = 5.0
"""Distance from its home beyond which the payload is lost [m]."""
MAX_ANGLE = 2.5
"""Rotation beyond which the payload is lost [rad]: near pi the rotation springs push the wrong way round."""
SETTLING_TIME = 2.0
"""Time for which the payload settles in the robots' springs before a run [s]."""
_GRAVITY = 9.81  # [m/s²]
_SURE, _SAFE = 1.05, 0.8
"""Shares of ``MAX_DISTANCE`` and ``MAX_ANGLE``: a payload that is predicted to exceed the first is refused, and the
recommended mass stays within the second."""
_STEP = 0.01  # of a predicted fall [s]
_WATCHED = 10.0
"""Time after which a payload that has not been lost will not be lost by its weight [s]."""
_HALVINGS = 5
"""Resolution of the search for the heaviest load, as a share of the range."""


class Strength:
    """Loads that the springs of a team's arms can hold."""

    def __init__(self, grasps: Sequence[Pose], robots: Robots) -> None:
        self._places = places = np.array([grasp.translation for grasp in grasps])
        self._count = len(places)
        self._middle = places.mean(axis=0)
        self._robots = robots
        self._springs = gains_at_payload(grasps, robots.stiffness)
        self._dampers = gains_at_payload(grasps, robots.damping)
        at_middle = gains_at_payload([Pose(np.eye(3), place - self._middle) for place in places], robots.stiffness)
        self._least_turning = float(np.linalg.eigvalsh(at_middle[:3, :3])[0])

    @classmethod
    def of(cls, grasps: Sequence[Pose], robots: Robots) -> Self | None:
        """Make the strength of a team's arms; None for seven-joint arms, whose hands are welded to the payload."""
        return cls(grasps, robots) if grasps and robots.arms != "seven-joint" else None

    def complaint(self, load: Inertia, before: Inertia | None = None) -> str:
        """Describe what is wrong with a load's weight, as the end of a sentence; empty if it can be held.

        ``before`` is the body that has settled in the springs; None if the load is the payload itself.
        """
        with np.errstate(all="ignore"):
            if self._is_light(_together(before, load)):
                return ""
            start = None if before is None else self._falls(before, Pose.identity(), SETTLING_TIME, math.inf)

            def is_held(load: Inertia, share: float) -> bool:
                """Whether the payload is predicted to stay within a share of the limits at which it is lost."""
                after = _together(before, load)
                if self._is_light(after):
                    return True
                settled = start or self._falls(after, Pose.identity(), SETTLING_TIME, math.inf)
                return settled is not None and self._falls(after, settled, _WATCHED, share) is not None

            if is_held(load, _SURE):
                return ""
            most = _most(
                load.mass, lambda part: is_held(Inertia(part * load.mass, load.com, part * load.tensor), _SAFE)
            )
        arms = f"{self._count} arms" if self._count > 1 else "one arm"
        expected = f"at most {most:g} kg" if most > 0.0 else "nothing more"
        there = "" if before is None else " there"
        return (
            f"more than {arms} with 'robots.stiffness' = {list(self._robots.stiffness)} can hold up{there}; expected "
            f"{expected}: masses are in kg"
        )

    def _is_light(self, inertia: Inertia) -> bool:
        """Whether the springs hardly give way, so that no prediction is needed."""
        weight = _GRAVITY * inertia.mass
        sag = weight / (self._count * self._robots.stiffness[0])
        # An upper bound of the rotation, because the weight's lever becomes shorter.
        tilt = weight * float(np.linalg.norm(inertia.com - self._middle)) / max(self._least_turning, 1e-300)
        return tilt < 0.2 * MAX_ANGLE and sag + tilt * float(np.linalg.norm(self._middle)) < 0.2 * MAX_DISTANCE

    def _pull(self, inertia: Inertia, pose: Pose) -> Array:
        """Return the wrench ``(t, f)`` of springs and weight at the payload's origin in its own axes, shape (6,)."""
        k_t, k_r = self._robots.stiffness
        rotation = pose.rotation
        weight = -_GRAVITY * inertia.mass * rotation[2]
        # Each spring pulls its hand to its home position, given in the payload's present frame.
        forces = k_t * ((self._places - pose.translation) @ rotation - self._places)
        torque = np.cross(self._places, forces).sum(axis=0) - self._count * k_r * rotation_log(rotation)
        return np.concatenate([torque + skew(inertia.com) @ weight, forces.sum(axis=0) + weight])

    def _falls(self, inertia: Inertia, pose: Pose, seconds: float, share: float) -> Pose | None:
        """Return the pose of the payload some time after it was at rest; None if it exceeded the share meanwhile.

        It uses Euler's implicit method with the springs and dampers of the home pose, which is stable also for light
        payloads in strong springs.
        """
        mass, resistance = inertia.spatial(), self._dampers + _STEP * self._springs
        try:
            give = _STEP * np.linalg.inv(mass + _STEP * resistance)
        except np.linalg.LinAlgError:
            return None
        twist = np.zeros(6)
        for _ in range(round(seconds / _STEP)):
            # A constant momentum rotates in the payload's frame.
            angular, linear = skew(mass[:3] @ twist), skew(mass[3:] @ twist)
            gyroscopic = np.concatenate([angular @ twist[:3] + linear @ twist[3:], linear @ twist[:3]])
            twist = twist + give @ (self._pull(inertia, pose) + gyroscopic - resistance @ twist)
            pose = pose @ Pose(rotation_exp(_STEP * twist[:3]), _STEP * twist[3:])
            distance, angle = np.linalg.norm(pose.translation), np.linalg.norm(rotation_log(pose.rotation))
            if not (distance < share * MAX_DISTANCE and angle < share * MAX_ANGLE):
                return None
        return pose


def gains_at_payload(grasps: Sequence[Pose], gains: tuple[float, float]) -> Array:
    """Return the sum of all arms' gains (translation, rotation) for the payload's twist ``(w, v)``, shape (6, 6)."""
    at_grasp = np.repeat([gains[1], gains[0]], 3)
    adjoints = [grasp.inverse().adjoint() for grasp in grasps]
    result: Array = np.sum([adjoint.T @ (at_grasp[:, None] * adjoint) for adjoint in adjoints], axis=0)
    return result


def _together(before: Inertia | None, load: Inertia) -> Inertia:
    return load if before is None else combined([before, load])


def _most(mass: float, is_held: Callable[[float], bool]) -> float:
    """Return the largest mass [kg] of which a share is held, rounded down to two digits; 0 if hardly any is."""
    share = 1.0
    while not is_held(0.5 * share):
        share *= 0.5
        if share < 1e-9:
            return 0.0
    low, high = 0.5 * share, share
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_held(middle) else (low, middle)
    return rounded_down(low * mass)

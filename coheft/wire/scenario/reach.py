"""Limits of references: the server refuses larger ones, and scenarios with such motions are refused.

They allow much more than any useful motion, but a robot that uses them fully cannot tear the payload from the others:
held by N springs, the payload moves by an N-th of the displacement, and at most twice as far before it comes to rest.
"""

import operator

import numpy as np

from coheft.wire.messages.structs import Reference
from coheft.wire.scenario.schema import Robots

MAX_POSITION = 2.0
"""Largest displacement from the home pose along an axis of the home frame [m]."""
MAX_ROTATION = 2.0 * np.pi
"""Largest component of the rotation vector [rad]."""
_LONGEST_SAMPLE = 0.01  # period of the lowest sensor rate [s]


class Reach:
    """Limits of references for a scenario's arms.

    A rate counts with the displacement to which the arm's damping makes it equal, a wrench with that to which its
    stiffness does: where there is no stiffness, there is no feed-forward either.

    Attributes:
        rotation_delay: Displacement for which a rate counts, rotation [s].
        position_delay: The same, translation [s].
    """

    def __init__(self, robots: Robots) -> None:
        (k_t, k_r), (d_t, d_r) = robots.stiffness, robots.damping
        # A rate counts for a sample at least; motions name the rotation first.
        self.rotation_delay = max(d_r / k_r if k_r > 0.0 else 0.0, _LONGEST_SAMPLE)
        self.position_delay = max(d_t / k_t, _LONGEST_SAMPLE)
        self._delay = np.repeat([self.rotation_delay, self.position_delay], 3)
        self._displacement = np.repeat([MAX_ROTATION, MAX_POSITION], 3)
        self._wrench = [k_t * MAX_POSITION] * 3 + [k_r * MAX_ROTATION] * 3  # wrenches name the force first
        self._surely = float((self._displacement / (1.0 + self._delay)).min())  # of displacement and rate alike

    def excess(self, reference: Reference) -> str | None:
        """Describe why the arm cannot follow a reference of the right shapes, finite or not; None if it can."""
        motion, wrench = np.abs(reference.motion), [abs(each) for each in reference.wrench.tolist()]
        if motion.max() <= self._surely and all(map(operator.le, wrench, self._wrench)):
            return None  # nearly always, and faster than what follows
        asked = motion[:, :6] + self._delay * motion[:, 6:]
        parts = (
            ("motion", asked.max(axis=0), self._displacement, ("rad", "m")),
            ("wrench", wrench, self._wrench, ("N", "N·m")),
        )
        for name, largest, limits, units in parts:
            for axis, (found, limit) in enumerate(zip(largest, limits, strict=True)):
                if not found <= limit:
                    return f"{name} asks for {found:.3g} {units[axis // 3]} but expected at most {limit:.3g}"
        return None

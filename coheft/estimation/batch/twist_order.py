"""Whether twists have the angular velocity first.

Robots that hold one load turn equally fast, but their hands move at different velocities.
"""

import numpy as np

from coheft.errors import RecordingError
from coheft.estimation.batch.recording import Recording

_SPAN = 0.1
"""Time over which velocities are averaged [s]."""
_SLOWEST = 0.02
"""Root mean square below which velocities may be nothing but noise [rad/s, m/s]."""
_BETTER = 0.3
"""Largest ratio of the differences between robots with another order to those with the expected one."""


def check_twists(recording: Recording) -> None:
    """Check that the first three columns of twists, and not the last, may be angular velocities of one load.

    Raises:
        RecordingError: The last three of one robot, or of all, fit better.
    """
    if not recording.has("twist"):
        return
    steps = max(1, round(_SPAN * recording.rate))
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
    if best == 0 or apart[best] > _BETTER * apart[0]:
        return
    wrong = ", ".join(name for name, half in zip(recording.names, orders[best], strict=True) if half)
    raise RecordingError(
        f"'twist' of {wrong}: robots that hold one load turn equally fast, but only with the last three columns as "
        f"angular velocities these do. Give the angular velocity first, wx wy wz vx vy vz"
    )

"""Poses that jump: nothing was measured in between, and no filter across a jump says how the load moved.

Trackers lose sight, logs have gaps, parts of several recordings are put together.
"""

from __future__ import annotations

import numpy as np

from coheft.errors import RecordingError
from coheft.estimation.batch.recording import Recording

_SPAN = 0.02
"""Steps are taken over so long, or from one sample to the next [s]: noise of 2° or 3 cm is no jump."""
_FASTEST_TURN, _FASTEST = 20.0, 10.0
"""Faster than anything that robots carry [rad/s, m/s]."""


def check_jumps(recording: Recording) -> None:
    """Check that no robot's pose jumps.

    Raises:
        RecordingError: One does; says when, and by how much.
    """
    steps = max(1, round(_SPAN * recording.rate))
    seconds = steps / recording.rate
    for name, robot in recording.robots.items():
        if robot.pose is None:
            continue
        before, after = robot.pose[:-steps], robot.pose[steps:]
        along = np.abs(np.einsum("ki,ki->k", before[:, 3:], after[:, 3:]))
        turn = 2.0 * np.arccos(np.minimum(along, 1.0))
        shift = np.linalg.norm(after[:, :3] - before[:, :3], axis=1)
        is_jump = (turn > _FASTEST_TURN * seconds) | (shift > _FASTEST * seconds)
        if is_jump.any():
            first = int(np.argmax(is_jump))
            raise RecordingError(
                f"'pose' of {name} jumps at {robot.time[first + steps]:g} s, by {np.degrees(turn[first]):.3g}° and "
                f"{shift[first]:.3g} m within {seconds:g} s: choose a part without jumps with --from and --to. If it "
                f"jumps all the time, are times in seconds, positions in metres, and quaternions in the order "
                f"qx qy qz qw?"
            )

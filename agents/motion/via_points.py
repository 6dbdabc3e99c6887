"""Reference motion along straight lines between random points, followed by points at which the robot rests."""

import numpy as np

from coheft.estimation.geometry.smooth_step import least_jerk_step
from coheft.estimation.geometry.spatial import Array
from coheft.wire.scenario.motion import Motion, ViaPoints


class ViaPointMotion:
    """Moves to random points at random times, drawn by this robot alone (Zhang et al., sec. IV-C).

    The last points are held still: all robots rest at the same times, so that gravity is the only load, in a different
    direction each time. Their heights are spread over the whole range, in random order. Then the motion starts again.
    """

    def __init__(self, motion: Motion, via: ViaPoints, seed: int, rate: int, block: int) -> None:
        rng = np.random.default_rng(seed)
        reach = motion.translation * np.array(motion.axes[3:])
        points = rng.uniform(-reach, reach, size=(via.count, 3))
        moves = np.column_stack([rng.uniform(*via.transit, size=via.count), rng.uniform(*via.dwell, size=via.count)])
        holds = rng.uniform(-reach, reach, size=(via.holds, 3))
        holds[:, 2] = reach[2] * rng.permutation(np.linspace(-1.0, 1.0, via.holds))
        # All robots finish their moves at the same time, when the holds begin.
        moves *= via.count * (np.mean(via.transit) + np.mean(via.dwell)) / moves.sum()
        stops = [[via.hold_transit, via.hold_time]] * via.holds + [[via.hold_transit, 0.0]]
        home = np.zeros((1, 3))
        self._points = np.repeat(np.vstack([home, points, holds, home]), 2, axis=0)[1:]
        self._times = np.concatenate([[0.0], np.cumsum(np.vstack([moves, stops]))])
        self._rate = rate
        self._block = block

    def reference(self, block: int) -> Array:
        """See ``ReferenceMotion.reference``."""
        time = (block * self._block + np.arange(self._block)) / self._rate
        time %= self._times[-1]
        k = np.searchsorted(self._times, time, side="right") - 1
        duration = self._times[k + 1] - self._times[k]
        s = ((time - self._times[k]) / duration)[:, None]
        way = self._points[k + 1] - self._points[k]
        motion = np.zeros((self._block, 12))
        share, rate = least_jerk_step(s)
        motion[:, 3:6] = self._points[k] + way * share
        motion[:, 9:] = way * rate / duration[:, None]
        return motion

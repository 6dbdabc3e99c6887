"""Where robots hold a load, from their twists: all pairs, then all together."""

from __future__ import annotations

import numpy as np

from coheft.estimation.batch.loop_closure import ClosedLoops, LoopError, close_loops, loop_errors
from coheft.estimation.batch.pairs import kabsch, pair_pose
from coheft.estimation.batch.signals import Signals
from coheft.estimation.geometry.observability import PoseEstimate
from coheft.estimation.geometry.spatial import Array


def grasps_from_twists(signals: Signals, with_instruments: bool) -> tuple[ClosedLoops, list[LoopError]]:
    """Poses of all pairs from their twists, then of the team, and by how much loops of seen pairs failed to close."""
    twists = np.concatenate([signals.w, signals.v], axis=-1)
    count = len(twists)
    pairs: dict[tuple[int, int], PoseEstimate] = {}
    for i in range(count):
        for j in range(i + 1, count):
            instrument = _instrument(signals.w, i, j) if with_instruments else None
            pairs[i, j] = pair_pose(twists[i], twists[j], signals.rate, instrument)
    seen = {pair: estimate for pair, estimate in pairs.items() if not estimate.unseen}
    return close_loops(count, pairs), loop_errors(seen)


def _instrument(w: Array, i: int, j: int) -> Array:
    """What the robots that are not of this pair say of ``w_i``, on average; of two robots, what the other one says."""
    third = [k for k in range(len(w)) if k not in (i, j)] or [j]
    result: Array = np.mean([w[k] @ kabsch(w[i], w[k]).T for k in third], axis=0)
    return result

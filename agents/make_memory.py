"""Which kind of memory of the load an agent has."""

from __future__ import annotations

import numpy as np

from agents.disturbance import COHERENCE
from agents.load_moments import RIDERS
from coheft.estimation.forgetting_window import ForgettingWindow
from coheft.estimation.inertia import INERTIA_SIZE, OFFSET_SIZE
from coheft.estimation.load_change import LoadWindow
from coheft.estimation.load_samples import Memory
from coheft.wire.config import AgentConfig

_TURN, _FEWEST = 0.12, 2
"""Robots take turns of so long, or of so many blocks, in testing whether the load has changed: neighbours tell each
other [s, blocks];"""
_LONGEST_TURN = 0.3
"""and of so long where two others test meanwhile [s]."""
_FLOOR = 1e3
"""A memory that fades knows every number of the load within so much, in its unit."""


def make_memory(config: AgentConfig, own: int, members: int) -> Memory:
    """The one that an agent is told to have; ``own`` is the robot's index in its team, of so many members."""
    memory = config.efficient.memory
    if memory == "window":
        turns = max(_FEWEST, config.blocks(_TURN), min(members // 2, config.blocks(_LONGEST_TURN)))
        # Turns are as far apart as they can be, and no two in a row begin with the same borders.
        turn = own * turns + own * turns // members
        return LoadWindow(riders=RIDERS, coherence=COHERENCE * config.rate, every=turns, turn=turn)
    floor = np.full(INERTIA_SIZE + OFFSET_SIZE * config.efficient.offsets, _FLOOR)
    return ForgettingWindow(memory * config.rate / config.block, floor, riders=RIDERS)

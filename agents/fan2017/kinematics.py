"""The channel by which robots send the twists and accelerations of a block's samples to their neighbours."""

from __future__ import annotations

from coheft.agents.estimator import Channels
from coheft.estimation.measurement import KINEMATICS_SIZE

CHANNEL = "kinematics"
"""Its name; columns ``KINEMATICS`` of a ``MeasurementBlock``, shape (B, 9)."""


def are_readable(channels: Channels, block: int) -> bool:
    """Whether there are none among what a neighbour sent, or those of as many samples as a block has."""
    rows = channels.get(CHANNEL)
    return rows is None or rows.shape == (block, KINEMATICS_SIZE)

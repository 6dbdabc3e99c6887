"""Names of what may be wrong with a recording; reports have them, and ``--assume`` takes them."""

from __future__ import annotations

from enum import StrEnum


class Cause(StrEnum):
    """What may be wrong."""

    OFFSET = "offset"
    LEVER = "lever"
    SCALE = "scale"
    FORCE_SCALE = "force scale"
    MOMENT_SCALE = "moment scale"
    BASE_AXES = "base axes"
    TURNED = "sensor turned"
    COMPENSATED = "weight compensated"
    CLOCK = "clock"
    GRAVITY = "gravity"
    LOAD_CHANGE = "load change"
    OFFSET_JUMP = "offset jump"
    DRIFT = "drift"
    NOT_LEVEL = "homes not level"
    INVERSE = "inverse poses"
    SLIP = "slip"
    DEAD = "sensor dead"
    MOTION = "motion sensor"
    UNKNOWN = "unknown"
    """No single cause explains it."""

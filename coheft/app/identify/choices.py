"""What a user may choose about an identification; nothing heavy is loaded for it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

Method = Literal["batch", "instruments", "pose", "likelihood", "static"]


@dataclass(frozen=True)
class Bounds:
    """How wrong robots may be that are not calibrated: errors are anywhere within plus or minus these.

    Attributes:
        misalignment_deg: With --calibrate: how far the gimbal's zero may be off, about any axis [degrees].
        angle_scale: With --calibrate: how far the scale of each gimbal angle may be off, as a share of it.
        position_scale: With --calibrate: the same for the position.
        force_scale: With --calibrate: the same for the force.
        force_offset: With --calibrate: constant error of each axis of the force [N].
    """

    misalignment_deg: float = 1.0
    angle_scale: float = 0.01
    position_scale: float = 0.03
    force_scale: float = 0.01
    force_offset: float = 0.5


@dataclass(frozen=True, kw_only=True)
class Options:
    """How a recording is evaluated; ``coheft identify`` and ``coheft.identify`` call them alike.

    Attributes:
        method: ``batch``, ``instruments``, ``pose``, ``likelihood`` or ``static``; without it, what suits best.
        calibrate: The robots are not well calibrated; what is wrong with them is estimated as well (method ``pose``).
        bounds: With ``calibrate``: how wrong they may be.
        from_: Leave out what was before [s].
        to: Leave out what came after [s].
        cutoff: Of the low-pass filter [Hz].
        topics: Of an MCAP file or a bag: which are of which robot, ``ROBOT=TOPIC`` each.
        holds: Recording of the same load, held still in some orientations by the same robots.
        assume: What is wrong with the recording, by the name that its verdict has: it is taken out.
    """

    method: Method | None = None
    calibrate: bool = False
    bounds: Bounds | None = None
    from_: float | None = None
    to: float | None = None
    cutoff: float | None = None
    topics: tuple[str, ...] = ()
    holds: Path | None = None
    assume: str | None = None

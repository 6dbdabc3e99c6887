"""Motion from point to point, as a scenario asks for it."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from coheft.estimation.measurement import Positive
from coheft.wire.scenario.section import NotNegative, Section


class ViaPoints(Section, frozen=True):
    """Random via points in the range of the motion's ``translation`` and ``axes``, straight lines between them.

    Attributes:
        count: Number of via points.
        transit: Range of the random time from one to the next [s].
        dwell: Range of the random time spent there [s].
        holds: Number of further random points where all robots hold still at the same times.
        hold_time: How long each of them is held [s].
        hold_transit: Time to get there [s].
    """

    count: Annotated[int, Meta(ge=2, le=10_000)] = 80
    transit: tuple[Positive, Positive] = (0.8, 2.0)
    dwell: tuple[NotNegative, NotNegative] = (0.2, 0.8)
    holds: Annotated[int, Meta(ge=0, le=1000)] = 6
    hold_time: Positive = 8.0
    hold_transit: Positive = 2.0

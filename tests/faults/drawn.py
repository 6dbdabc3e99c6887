"""Schedules of a seed with a choice of what ``draw_schedule`` draws for it."""

from __future__ import annotations

import pytest

from coheft.app.faults import draw
from coheft.app.faults.schedule import FaultSchedule


def drawn(seed: int, **shares: float) -> FaultSchedule:
    """The schedule of a seed if ``LASTING`` or ``UNLIKE``, the shares of schedules with these, were others."""
    with pytest.MonkeyPatch.context() as patch:
        for name, share in shares.items():
            patch.setattr(draw, name, share)
        return draw.draw_schedule(seed)


def plain(seed: int, *, delayed: bool | None = None) -> FaultSchedule:
    """The faults of a seed, in a team of like robots whose sensors have no errors that last.

    None: everything happens later if it would in the schedule of this seed.
    """
    schedule = draw.draw_early(seed)
    if seed % 2 == 1 if delayed is None else delayed:
        schedule = draw.later(schedule)
    return draw.long_enough(schedule)

"""Until when the load may have changed unnoticed, because sums were missing."""

from __future__ import annotations

from agents.completeness import Completeness
from coheft.wire.config import agent_config
from tests.in_process import changed

CONFIG = agent_config(changed("ring3"), "r1", ("r2", "r3"))
"""50 blocks a second: 0.25 s are 12 of them."""
SETTLING = 25


def settled(completeness: Completeness, first: int) -> int:
    """The block, of those in a row from one on, with which the doubt goes."""
    block = first
    completeness.note(block)
    while completeness.recent_gap is not None:
        block += 1
        completeness.note(block)
    return block


def test_what_may_be_wrong_at_first_has_time_to_show() -> None:
    completeness = Completeness(CONFIG, 1, SETTLING)
    assert completeness.newest == -1
    assert settled(completeness, 100) == 100 + SETTLING


def test_a_gap_does_not_make_that_time_shorter() -> None:
    completeness = Completeness(CONFIG, 1, SETTLING)
    completeness.note(100)
    assert settled(completeness, 120) == 120 + SETTLING


def test_after_a_gap_a_change_has_time_to_be_noticed() -> None:
    completeness = Completeness(CONFIG, 1, SETTLING)
    newest = settled(completeness, 100)
    completeness.note(newest + 5)  # short enough for a change to be noticed anyway
    assert completeness.recent_gap is None
    assert completeness.gap(newest + 10) is None
    assert completeness.gap(newest + 40) == f"no complete sum of the team since {CONFIG.start_of(newest + 6):.2f} s"
    assert settled(completeness, newest + 40) == newest + 40 + 12

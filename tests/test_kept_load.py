"""What robots keep of the load from one team to the next, and tell those who have lost it."""

from __future__ import annotations

import numpy as np
import pytest

from agents.kept_load import KeptLoad
from coheft.estimation.load_comparison import KnownLoad

FRAME, OTHER, SHIFTED = (7, "r1"), (8, "r1"), (7, "r2")


def known(mass: float) -> KnownLoad:
    root = np.random.default_rng(1).normal(size=(10, 10))
    return KnownLoad(np.concatenate([[mass], np.arange(9.0)]), root @ root.T)


def test_it_is_known_in_the_body_frame_of_its_team_only() -> None:
    kept, load = KeptLoad(), known(5.0)
    assert kept.channels(FRAME) == {}
    kept.keep(FRAME, load)
    assert kept.seen_in(FRAME) is load
    assert kept.seen_in(OTHER) is None
    assert kept.seen_in(SHIFTED) is None  # another robot defines it
    assert kept.channels(SHIFTED) == {}
    kept.keep(FRAME, None)  # a team that was too short-lived to know it
    assert kept.seen_in(FRAME) is load
    kept.forget()
    assert kept.seen_in(FRAME) is None


def test_who_has_lost_it_is_told_by_neighbours_and_tells_others() -> None:
    knows, asks, relays = KeptLoad(), KeptLoad(), KeptLoad()
    knows.keep(FRAME, known(5.0))
    asks.hear({"r1": {}, "r2": knows.channels(FRAME)}, FRAME)
    relays.hear({"r3": asks.channels(FRAME)}, FRAME)
    for kept in (asks, relays):
        heard = kept.seen_in(FRAME)
        assert heard is not None
        for told, true in zip(heard, known(5.0), strict=True):
            np.testing.assert_array_equal(told, true)


def test_what_a_robot_knows_itself_it_does_not_ask_for() -> None:
    own, other = KeptLoad(), KeptLoad()
    own.keep(FRAME, known(5.0))
    other.keep(FRAME, known(6.0))
    own.hear({"r2": other.channels(FRAME)}, FRAME)
    heard = own.seen_in(FRAME)
    assert heard is not None
    assert heard.parameters[0] == 5.0


@pytest.mark.parametrize("spoil", ["frame", "robot", "shape", "variance", "covariance", "nothing known"])
def test_what_cannot_be_is_not_heard(spoil: str) -> None:
    knows, asks = KeptLoad(), KeptLoad()
    knows.keep(FRAME, known(5.0))
    (told,) = knows.channels(FRAME).values()
    told = told.copy()
    if spoil == "frame":
        told[0] = OTHER[0]
    elif spoil == "shape":
        told = told[:-1]
    elif spoil == "robot":
        told[1] += 1.0
    elif spoil == "variance":
        told[12] = -1.0
    elif spoil == "covariance":
        told[13] = 1e6
    else:
        told[12:] = 0.0
    asks.hear({"r2": dict.fromkeys(knows.channels(FRAME), told)}, FRAME)
    assert asks.seen_in(FRAME) is None

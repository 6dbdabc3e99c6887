"""Fits happen at the same blocks for everybody, one step after the other, ever rarer."""

from __future__ import annotations

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from agents.fit_rounds import FitRound, FitRounds

START = 240
lengths = st.tuples(st.integers(1, 12), st.integers(2, 13), st.integers(1, 20))


def all_rounds(under_way: int, hearing: int, shortest: int, joined: int = START, blocks: int = 4000) -> list[FitRound]:
    """What somebody sees who joins at a block."""
    rounds = FitRounds(START, under_way, hearing, shortest, 0.04)
    return list(dict.fromkeys(rounds.at(block) for block in range(joined, START + blocks)))


@given(lengths)
def test_steps_follow_each_other_and_leave_time_to_hear(sizes: tuple[int, int, int]) -> None:
    under_way, hearing, _ = sizes
    rounds = all_rounds(*sizes)
    assert [fit_round.number for fit_round in rounds] == [*range(len(rounds))]
    for one in rounds:
        assert one.fit - one.tell == one.switch - one.fit == hearing
        assert one.map - one.switch == under_way
        # Those with a block of delay tell at the next block, and must be heard as well.
        assert one.correct - (one.map + 1) == hearing
    for one, following in pairwise(rounds):
        assert one.correct < following.tell


@given(lengths, st.integers(0, 2000))
def test_who_joins_late_agrees(sizes: tuple[int, int, int], late: int) -> None:
    in_time, joined = all_rounds(*sizes), all_rounds(*sizes, joined=START + late)
    assert joined == in_time[-len(joined) :]


def test_rounds_become_rarer_as_the_data_grow() -> None:
    fits = [one.fit - START for one in all_rounds(3, 4, 10, blocks=20_000)]
    late = [following - one for one, following in pairwise(fits) if one > 5000]
    assert all(gap >= 0.04 * 5000 for gap in late)
    assert len(fits) < 200

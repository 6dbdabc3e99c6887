"""When regular work is due, where every block is stepped for and where some are skipped."""

from __future__ import annotations

import pytest

from coheft.agents.regular import Regular


@pytest.mark.parametrize("first", [0, 3, 10])
def test_it_is_due_at_multiples(first: int) -> None:
    regular = Regular(5)
    assert [block for block in range(first, 31) if regular.is_due(block)] == [
        block for block in range(first, 31) if block % 5 == 0
    ]


@pytest.mark.parametrize("stride", [2, 5, 7, 10])
def test_who_skips_blocks_does_it_as_often_as_it_can(stride: int) -> None:
    regular = Regular(5)
    blocks = range(3, 203, stride)
    due = [block for block in blocks if regular.is_due(block)]
    multiples = range(5, blocks[-1] + 1, 5)
    assert due == sorted({next(block for block in blocks if block >= multiple) for multiple in multiples})

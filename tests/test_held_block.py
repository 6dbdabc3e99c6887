"""A block that surprises waits for the next one."""

from __future__ import annotations

import numpy as np

from agents.held_block import Block, HeldBlock
from coheft.estimation.registration import RegistrationMoments

CALM, SURPRISING = 3.0, 300.0


def block(number: int) -> Block:
    return Block(number, RegistrationMoments.none(), np.zeros(1))


def admitted(*surprises: float) -> list[list[int]]:
    """Numbers of the blocks that can be learned from, after each that comes."""
    held = HeldBlock()
    return [[each.number for each in held.admit(block(number), size)] for number, size in enumerate(surprises)]


def test_blocks_without_surprise_count_at_once() -> None:
    assert admitted(CALM, CALM, CALM) == [[0], [1], [2]]


def test_a_glitch_never_counts() -> None:
    assert admitted(CALM, SURPRISING, CALM, CALM) == [[0], [], [2], [3]]


def test_what_goes_on_counts_from_its_first_block_on() -> None:
    assert admitted(CALM, SURPRISING, SURPRISING, SURPRISING, SURPRISING) == [[0], [], [1, 2], [], [3, 4]]


def test_two_glitches_apart_are_not_taken_for_something_that_goes_on() -> None:
    assert admitted(SURPRISING, CALM, SURPRISING, CALM) == [[], [1], [], [3]]


def test_what_is_dropped_is_not_waited_for() -> None:
    held = HeldBlock()
    assert held.admit(block(0), SURPRISING) == ()
    held.drop()
    assert held.admit(block(1), SURPRISING) == ()

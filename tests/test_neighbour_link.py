"""What an agent's process keeps of one neighbour, and when it waits for it."""

from __future__ import annotations

import itertools

import pytest

from coheft.agents.process.neighbour_link import LONGEST_PAUSE, MOST_KEPT, SILENCE, NeighbourLink
from coheft.wire.messages.structs import Hello, NeighbourMessage

NOW = 100.0


def message(block: int, incarnation: int = 1) -> NeighbourMessage:
    return NeighbourMessage(sender="r2", block=block, gossip=[], channels={}, incarnation=incarnation)


@pytest.fixture
def link() -> NeighbourLink:
    """A neighbour that has sent its message of block 9 in time."""
    link = NeighbourLink("r2", NOW)
    link.note_presence(True)
    link.take_message(message(9), 10, NOW)
    return link


def test_a_step_waits_for_a_neighbour_that_keeps_pace_until_its_message_is_there(link):
    assert not link.is_missing(10)
    link.take_messages(10)
    assert link.is_missing(11)
    link.take_message(message(10), 11, NOW)
    assert not link.is_missing(11)


def test_no_robot_waits_for_a_neighbour_that_is_gone_until_it_is_heard_in_time_again(link):
    link.take_messages(10)
    link.note_presence(False)
    assert not link.is_missing(11)
    link.note_presence(True)
    assert not link.is_missing(11)
    link.take_message(message(8), 11, NOW)
    assert not link.is_missing(12), "a late message is no sign of keeping pace"
    link.take_message(message(11), 12, NOW)
    assert link.is_missing(13)


def test_nobody_waits_for_what_a_neighbour_has_skipped(link):
    link.take_messages(10)
    link.take_message(message(14), 11, NOW)
    assert not link.is_missing(11)
    assert link.is_missing(16)


def test_messages_that_come_early_wait_for_their_step_and_all_others_go_to_the_next(link):
    link.take_messages(10)
    early, late, nonsense = message(12), message(3), message(10**6)
    for said in (early, late, nonsense):
        link.take_message(said, 11, NOW)
    assert link.take_messages(11) == [late, nonsense]
    assert link.take_messages(12) == []
    assert link.take_messages(13) == [early]


def test_what_a_neighbour_said_before_it_started_again_is_waited_for_no_longer(link):
    link.take_messages(10)
    link.take_message(message(10), 11, NOW)
    link.take_hello(Hello(sender="r2", heard=["r1"], incarnation=2), "r1", NOW)
    assert link.hears_us
    assert link.is_missing(11)
    link.take_message(message(10, incarnation=2), 11, NOW)
    assert not link.is_missing(11)


def test_a_life_that_a_neighbour_has_not_begun_is_forgotten_with_its_next_hello(link):
    link.take_messages(10)
    link.take_message(message(10, incarnation=64), 11, NOW)
    link.take_message(message(11), 11, NOW)
    assert link.is_missing(12), "what it says now seems to be from before"
    link.take_hello(Hello(sender="r2", heard=["r1"], incarnation=1), "r1", NOW)
    assert not link.is_missing(12)
    assert link.take_messages(11) == [message(10, incarnation=64)]
    assert link.take_messages(12) == [message(11)]


def test_however_much_a_neighbour_says_little_is_kept(link):
    for _ in range(100 * MOST_KEPT):
        link.take_message(message(11), 10, NOW)
    assert len(link.take_messages(12)) == MOST_KEPT


def test_a_link_that_goes_and_comes_back_is_told_once_each_but_not_that_it_comes_at_first():
    link = NeighbourLink("r2", NOW)
    assert not link.take_change()
    link.note_presence(True)
    assert not link.take_change()
    link.note_presence(False)
    assert link.take_change()
    assert not link.take_change()
    link.note_presence(True)
    assert link.take_change()
    link.note_presence(False)
    link.note_presence(True)
    assert not link.take_change(), "back before anybody asked"


def hello(*heard: str) -> Hello:
    return Hello(sender="r2", heard=list(heard))


def test_a_link_that_is_gone_is_begun_anew_at_once_and_then_with_growing_pauses(link):
    link.take_hello(hello("r1"), "r1", NOW + 10.0)
    assert link.is_whole
    assert not link.begin_anew(NOW + 10.0)
    link.note_presence(False)
    begun = [t for t in (NOW + 10.0 + 0.25 * step for step in range(1600)) if link.begin_anew(t)]
    pauses = [later - earlier for earlier, later in itertools.pairwise(begun)]
    assert begun[0] == NOW + 10.0
    assert pauses == [4.0, 8.0, 16.0, 32.0, *(len(pauses) - 4) * [LONGEST_PAUSE]]
    link.note_presence(True)
    link.take_hello(hello("r1"), "r1", begun[-1] + 1.0)
    assert not link.begin_anew(begun[-1] + 1.0)
    link.note_presence(False)
    assert link.begin_anew(begun[-1] + SILENCE), "it was whole in between"


@pytest.mark.parametrize("heard", [(), ("r3",)])
def test_a_link_that_stands_but_does_not_carry_to_the_neighbour_is_begun_anew(link, heard):
    link.take_hello(hello("r1"), "r1", NOW)
    assert not link.begin_anew(NOW + 10.0)
    link.take_hello(hello(*heard), "r1", NOW + 10.1)
    assert not link.begin_anew(NOW + 10.0 + SILENCE - 0.1)
    assert link.begin_anew(NOW + 10.0 + SILENCE)
    assert not link.is_linked


def test_a_neighbour_that_is_silent_is_not_heard_any_more_and_its_link_is_begun_anew(link):
    link.take_hello(hello("r1"), "r1", NOW)
    link.notice_silence(NOW + SILENCE)
    assert link.is_whole
    assert not link.begin_anew(NOW + SILENCE)
    link.notice_silence(NOW + SILENCE + 0.1)
    assert link.is_linked
    assert not link.is_heard
    assert not link.is_missing(11), "no one waits for it"
    assert not link.begin_anew(NOW + SILENCE + 0.1)
    assert link.begin_anew(NOW + 2.0 * SILENCE)

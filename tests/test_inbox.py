"""Which of the neighbours' messages are used: those of their time, however they come, and none that cannot be right."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from coheft.agents.inbox import LATE, NeighbourInbox
from coheft.wire.messages.structs import LinkState, NeighbourMessage

NEIGHBOURS = ("b", "c")


def message(sender: str = "b", block: int = 9, incarnation: int = 0) -> NeighbourMessage:
    """What this agent said after that block: nothing else will ever bear these numbers."""
    return NeighbourMessage(
        sender=sender,
        block=block,
        gossip=[LinkState(sender, block, ("a",), incarnation=incarnation)],
        channels={"x": np.array([float(block), float(incarnation)])},
        incarnation=incarnation,
    )


def take(
    inbox: NeighbourInbox, index: int, messages: Sequence[NeighbourMessage]
) -> tuple[list[NeighbourMessage], set[LinkState], Counter[str]]:
    """What is used, in order, what is heard of robots, and what was refused: no matter in which order."""
    used, gossip, problems, _ = inbox.take(index, messages)
    assert list(used) == [each.sender for each in used.values()]
    return list(used.values()), set(gossip), Counter(problems)


senders = st.sampled_from(NEIGHBOURS)


@given(
    st.lists(st.builds(message, st.sampled_from(["b", "c", "z"]), st.integers(0, 30), st.integers(0, 2)), max_size=12),
    st.data(),
)
def test_neither_order_nor_copies_matter(messages: list[NeighbourMessage], data: st.DataObject) -> None:
    plain, shuffled = NeighbourInbox(NEIGHBOURS), NeighbourInbox(NEIGHBOURS)
    for index in range(8, 13):
        coming = messages if index == 10 else []
        used, gossip, problems = take(plain, index, coming)
        again = take(shuffled, index, data.draw(st.permutations(2 * coming)))
        assert [(each.sender, each.block, each.incarnation) for each in again[0]] == [
            (each.sender, each.block, each.incarnation) for each in used
        ]
        assert again[1] == gossip
        assert again[2] == problems + problems
        assert [shuffled.last_heard(name) for name in NEIGHBOURS] == [plain.last_heard(name) for name in NEIGHBOURS]


@given(st.lists(st.tuples(senders, st.integers(0, 15), st.integers(1, 3)), max_size=30))
def test_a_message_is_used_at_the_next_block_if_it_comes_until_then(sent: list[tuple[str, int, int]]) -> None:
    """Each comes some blocks late, or in time."""
    inbox = NeighbourInbox(NEIGHBOURS)
    for index in range(20):
        coming = [message(sender, block) for sender, block, late in sent if block + late == index]
        used, gossip, problems = take(inbox, index, coming)
        assert [(each.sender, each.block) for each in used] == sorted(
            {(sender, block) for sender, block, late in sent if block + 1 == index and late == 1}
        )
        assert gossip == {record for each in coming for record in each.gossip}  # never too late
        assert problems == {}


def test_who_was_last_heard_when() -> None:
    inbox = NeighbourInbox(NEIGHBOURS)
    inbox.take(100, [])
    assert inbox.last_heard("b") == 100  # there was nothing to be heard before
    inbox.take(101, [message("b", 100)])
    inbox.take(105, [message("b", 100)])
    assert inbox.last_heard("b") == 101
    assert inbox.last_heard("c") == 100


def test_after_blocks_that_were_missed_only_the_newest_messages_are_used() -> None:
    inbox = NeighbourInbox(NEIGHBOURS)
    inbox.take(0, [])
    used, _, problems, _ = inbox.take(40, [message("b", block) for block in range(40)])
    assert used["b"].block == 39
    assert problems == []


def test_what_a_former_agent_said_is_void_as_soon_as_its_successor_has_spoken() -> None:
    inbox = NeighbourInbox(NEIGHBOURS)
    used, _, problems, _ = inbox.take(10, [message("b", 9), message("b", 5, incarnation=1)])
    assert used == {}
    assert problems == []
    used, gossip, problems, _ = inbox.take(11, [message("b", 10, incarnation=0)])
    assert used == {}
    assert gossip == []
    assert "before its sender restarted" in problems[0]


def test_of_two_agents_that_speak_of_one_block_the_newer_one_is_used() -> None:
    old, new = message("b", 9), message("b", 9, incarnation=1)
    used, _, _, _ = NeighbourInbox(NEIGHBOURS).take(10, [new, old])
    assert used["b"].incarnation == 1


def with_record(**changes: object) -> NeighbourMessage:
    return replace(message(), gossip=[replace(LinkState("d", 0, ("b",)), **changes)])


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (message("z"), "it is not a neighbour; neighbours are b, c"),
        (message("b", 10), "1 blocks ahead"),
        (message("b", -1), "its block is negative"),
        (replace(message(), channels={"x": np.array([1.0, np.nan])}), "channels['x']"),
        (replace(message(), channels={"y": np.array([[-np.inf]])}), "channels['y']"),
        (replace(message(), channels={"y": np.array([1e12])}), "channels['y']"),
        (replace(message(), channels={"y": np.array([2**40])}), "channels['y']"),  # whose square is 0 in 64 bits
        (with_record(sequence=-1), "'d' is impossible"),
        (with_record(incarnation=-1), "'d' is impossible"),
        (with_record(since=-1), "'d' is impossible"),
        (with_record(ready_block=-2), "'d' is impossible"),
        (with_record(ready_block=2**62), "'d' is impossible"),
        (with_record(team=2**32), "'d' is impossible"),
        (with_record(neighbours=("b", "d")), "'d' is impossible"),
    ],
)
def test_what_cannot_be_right_is_refused_as_a_whole(wrong: NeighbourMessage, words: str) -> None:
    inbox = NeighbourInbox(NEIGHBOURS)
    inbox.take(9, [])
    used, gossip, (problem,), _ = inbox.take(10, [wrong, message("c")])
    assert words in problem
    assert f"refused from {wrong.sender}, block {wrong.block}" in problem
    assert list(used) == ["c"]
    assert gossip == message("c").gossip
    # The true one may still come.
    used, _, problems, _ = inbox.take(11, [message("b", 10)])
    assert list(used) == ["b"]
    assert problems == []


def test_possible_records_and_empty_channels_are_welcome() -> None:
    welcome = replace(with_record(since=7), channels={"x": np.empty((0, 3)), "y": np.array(7.0)})
    used, gossip, problems, _ = NeighbourInbox(NEIGHBOURS).take(10, [welcome])
    assert used == {"b": welcome}
    assert gossip[0].since == 7
    assert problems == []


def test_arrays_that_no_estimator_here_reads_are_refused_in_words_once() -> None:
    inbox, told = NeighbourInbox(["r2"]), []
    for block in range(3):
        message = NeighbourMessage(sender="r2", block=block, gossip=[], channels={"sums": np.zeros(3)})
        used, _, problems, _ = inbox.take(block + 1, [message], fits=lambda _: False)
        assert used == {}
        told += problems
    assert len(told) == 1
    assert "run the same release of coheft" in told[0]


@given(st.permutations([(block, late) for block in range(4, 9) for late in (1, 3)]))
def test_what_comes_too_late_is_given_once_and_never_if_it_was_in_time(sent: list[tuple[int, int]]) -> None:
    inbox, found, due = NeighbourInbox(NEIGHBOURS), list[tuple[int, int]](), dict[int, int]()
    for block, late in sent:  # of each block one of the two comes, and both of the last
        due.setdefault(block, late)
    for index in range(4, 20):
        coming = [message("b", block) for block, late in due.items() if block + late == index] + [message("b", 3)]
        taken = inbox.take(index, coming, takes_late=True)
        found += [(each.block, index) for each in taken.late]
        assert all(each.block == index - 1 for each in taken.used.values())
    assert found == sorted((block, block + 3) for block, late in due.items() if late == 3)


def test_late_messages_keep_a_neighbour_from_being_silent_and_old_ones_are_left_out() -> None:
    inbox = NeighbourInbox(NEIGHBOURS)
    inbox.take(100, [])
    for index in range(101, 300):
        taken = inbox.take(index, [message("b", index - 5), message("c", index - 2 - LATE)], takes_late=True)
        assert [each.sender for each in taken.late] == ["b"]
    assert inbox.last_heard("b") == 299
    assert inbox.last_heard("c") == 100
    assert inbox.take(300, [message("b", 290)]).late == []  # this estimator cannot use any


def test_late_messages_of_a_former_life_are_left_out() -> None:
    inbox = NeighbourInbox(NEIGHBOURS)
    inbox.take(100, [message("b", 99, incarnation=1)])
    assert inbox.take(101, [message("b", 98, incarnation=0)], takes_late=True).late == []
    assert [each.block for each in inbox.take(102, [message("b", 98, incarnation=1)], takes_late=True).late] == [98]
    (new,) = inbox.take(103, [message("b", 98, incarnation=2)], takes_late=True).late
    assert new.incarnation == 2


def test_a_message_that_cannot_be_read_does_not_keep_out_the_right_one_of_its_block() -> None:
    inbox = NeighbourInbox(NEIGHBOURS)
    wrong = replace(message("b", 99), channels={"x": np.zeros((2, 1))})
    for index, coming in ((100, [wrong]), (101, []), (102, [message("b", 99), wrong])):
        taken = inbox.take(index, coming, lambda channels: channels["x"].ndim == 1, takes_late=True)
    assert [each.channels["x"].ndim for each in taken.late] == [1]
    assert inbox.last_heard("b") == 102
    assert inbox.take(103, [message("b", 99)], takes_late=True).late == []


def test_an_incarnation_that_was_too_large_is_corrected_after_a_while_but_not_by_what_is_old() -> None:
    inbox = NeighbourInbox(NEIGHBOURS)
    inbox.take(10, [message("b", 9, incarnation=2**30)])
    for index in range(11, 18):
        assert inbox.take(index, [message("b", index - 1, incarnation=1)]).used == {}
    _, _, (problem,), late = inbox.take(18, [message("b", 16, incarnation=1)], takes_late=True)
    assert "before its sender restarted" in problem
    assert late == []
    assert inbox.take(18, [message("b", 17, incarnation=1)]).used["b"].incarnation == 1

"""The simulated network: what arrives, when, and in which state."""

from __future__ import annotations

from typing import get_args

import msgspec
import numpy as np
import pytest

from coheft.agents.inbox import NeighbourInbox
from coheft.app.faults.messages import flip_bits, malformed
from coheft.app.faults.network import Network
from coheft.app.faults.schedule import (
    AnyFault,
    Corruption,
    Delay,
    Duplication,
    FaultSchedule,
    Lie,
    LieKind,
    Loss,
    Malformed,
    Partition,
    Reordering,
    Replay,
)
from coheft.wire.messages.structs import LinkState, NeighbourMessage
from tests.faults.drawn import plain

GRAPH = {"r1": ("r2", "r3"), "r2": ("r1", "r3"), "r3": ("r1", "r2")}
END = 1000.0


def schedule(*faults: AnyFault) -> FaultSchedule:
    return msgspec.structs.replace(plain(0), faults=faults)


def said(block: int, sender: str = "r1", incarnation: int = 0) -> NeighbourMessage:
    samples = np.arange(12.0).reshape(3, 4) + block
    gossip = [LinkState(sender, block, ("r2",))]
    return NeighbourMessage(
        sender=sender, block=block, gossip=gossip, channels={"samples": samples}, incarnation=incarnation
    )


def arrivals(*faults: AnyFault, blocks: int = 200, harmless: bool = True) -> list[list[NeighbourMessage]]:
    """What r2 gets from r1, block by block, when r1 says something after every block."""
    network = Network(schedule(*faults), GRAPH)
    network.harmless = harmless
    came = []
    for block in range(blocks):
        came.append(network.collect(block, "r2"))
        network.post(block, said(block))
    return came


def numbers(came: list[list[NeighbourMessage]]) -> list[list[int]]:
    return [sorted(message.block for message in inbox) for inbox in came]


def test_without_faults_everything_comes_with_the_next_block():
    assert numbers(arrivals()) == [[]] + [[block] for block in range(199)]


def test_faults_hold_from_their_start_to_their_end_and_on_their_link_only():
    block = schedule().scenario.block_duration
    during = {"start": 10 * block, "end": 20 * block - 1e-9}
    assert numbers(arrivals(Loss(**during, probability=1.0))) == [
        [] if b == 0 or 11 <= b < 21 else [b - 1] for b in range(200)
    ]
    for other in ({"sender": "r3"}, {"receiver": "r3"}):
        assert numbers(arrivals(Loss(**during, probability=1.0, **other))) == numbers(arrivals())


def test_loss_loses_its_share():
    came = sum(map(len, arrivals(Loss(start=0.0, end=END, probability=0.3, seed=1), blocks=4000)))
    assert came / 4000 == pytest.approx(0.7, abs=0.03)


def test_delay_delays_and_reordering_loses_nothing():
    assert numbers(arrivals(Delay(start=0.0, end=END, blocks=3)))[4:] == [[block] for block in range(196)]
    came = numbers(arrivals(Reordering(start=0.0, end=END, blocks=4, seed=2)))
    flat = [number for inbox in came for number in inbox]
    assert len(set(flat)) == len(flat)
    assert set(range(195)) <= set(flat)
    assert flat != sorted(flat)


def test_a_partition_cuts_both_ways_between_the_groups_only():
    network = Network(schedule(Partition(start=0.0, end=END, group=("r1",))), GRAPH)
    for name in GRAPH:
        network.post(0, said(0, name))
    heard = {name: {message.sender for message in network.collect(1, name)} for name in GRAPH}
    assert heard == {"r1": set(), "r2": {"r3"}, "r3": {"r2"}}


@pytest.mark.parametrize(
    "fault",
    [
        Duplication(start=0.0, end=END, probability=0.5, blocks=5),
        Replay(start=0.0, end=END, probability=0.5, source="had before"),
        Malformed(start=0.0, end=END, probability=0.5),
    ],
)
def test_harmless_messages_come_besides_the_others_which_do_not_change(fault: AnyFault):
    loss = Loss(start=0.0, end=END, probability=0.3, seed=3)
    with_them, without = arrivals(fault, loss), arrivals(fault, loss, harmless=False)
    assert sum(map(len, with_them)) > sum(map(len, without))
    assert numbers(without) == numbers(arrivals(loss))
    assert all(set(few) <= set(many) for many, few in zip(numbers(with_them), numbers(without), strict=True))


def test_no_robot_uses_a_malformed_message():
    rng = np.random.default_rng(2)
    for _ in range(40):
        inbox = NeighbourInbox(["r1"])
        inbox.take(3, [])
        used, gossip, _, late = inbox.take(
            4, [malformed(said(3), rng)], lambda channels: channels["samples"].shape == (3, 4), takes_late=True
        )
        assert (used, gossip, late) == ({}, [], [])
        used, _, _, _ = inbox.take(5, [said(4)], lambda channels: channels["samples"].shape == (3, 4))
        assert set(used) == {"r1"}, "nor does it harm those that come after it"


def test_replayed_messages_are_of_the_kind_that_was_asked_for():
    network = Network(schedule(Replay(start=0.0, end=END, probability=1.0, source="former incarnation")), GRAPH)
    replayed = []
    for block in range(40):
        replayed += [m for m in network.collect(block, "r2") if m.block != block - 1]
        network.post(block, said(block, incarnation=int(block >= 20)))
    assert len(replayed) == 18
    assert {message.incarnation for message in replayed} == {0}


def test_messages_of_another_run_never_arrive():
    network = Network(schedule(Replay(start=0.0, end=END, probability=1.0, source="other run")), GRAPH)
    for block in range(10):
        assert [message.block for message in network.collect(block, "r2")] == ([block - 1] if block else [])
        network.post(block, said(block))
    assert network.refused > 0


def test_flipped_bits_are_refused_unless_they_flip_before_the_checksum():
    rng = np.random.default_rng(4)
    damaged = Corruption(start=0.0, end=END, probability=1.0, bits=1)
    sealed = msgspec.structs.replace(damaged, sealed=True)
    assert all(flip_bits(said(block), damaged, rng) is None for block in range(500))
    survived = [flip_bits(said(7), sealed, rng) for _ in range(500)]
    changed = [
        m
        for m in survived
        if m is not None and not np.array_equal(m.channels.get("samples"), said(7).channels["samples"])
    ]
    assert len(changed) > 100


@pytest.mark.parametrize("how", get_args(LieKind))
def test_a_liar_changes_samples_but_not_what_others_are_told_of_the_graph(how: LieKind):
    network = Network(schedule(Lie(start=0.0, end=END, robot="r1", how=how, size=2.0)), GRAPH)
    network.post(0, said(0, "r1"))
    network.post(0, said(0, "r3"))
    heard = {message.sender: message for message in network.collect(1, "r2")}
    true = said(0).channels["samples"]
    np.testing.assert_array_equal(heard["r3"].channels["samples"], true)
    for sender, message in heard.items():
        assert msgspec.structs.replace(message, channels={}) == msgspec.structs.replace(said(0, sender), channels={})
    lied = heard["r1"].channels["samples"]
    assert lied.shape == true.shape
    assert not np.isclose(lied, true).any(where=true != 0.0)
    match how:
        case "scaled":
            np.testing.assert_array_equal(lied, 2.0 * true)
        case "offset":
            np.testing.assert_allclose(lied - true, 2.0 * np.sqrt(np.square(true).mean()))


def test_a_fresh_agent_gets_nothing_from_before():
    network = Network(schedule(Replay(start=0.0, end=END, probability=1.0, source="had before")), GRAPH)
    for block in range(10):
        network.collect(block, "r2")
        network.post(block, said(block))
    network.forget(20, "r2")
    assert network.collect(20, "r2") == []


def test_a_fresh_agent_gets_no_copies_of_what_its_former_life_has_had():
    network = Network(schedule(Duplication(start=0.0, end=END, probability=1.0, blocks=12)), GRAPH)
    for block in range(10):
        network.collect(block, "r2")
        network.post(block, said(block))
    network.forget(10, "r2")
    came = [message.block for block in range(10, 30) for message in network.collect(block, "r2")]
    assert came == [9]

"""Loss and delay of neighbours' messages, which are the same in one process and in many."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from coheft.agents.network import SimulatedNetwork
from coheft.app.run.inprocess import run_in_process
from coheft.wire.config import AgentConfig, agent_config
from coheft.wire.messages.structs import NeighbourMessage
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.network import LinkQuality
from tests.in_process import changed

BLOCKS = 2000


def receiver(quality: LinkQuality, name: str = "r2") -> AgentConfig:
    config = agent_config(load_scenario("ring3"), name, tuple(other for other in ("r1", "r2", "r3") if other != name))
    return replace(config, network=quality)


def arrivals(network: SimulatedNetwork, sender: str = "r1", blocks: int = BLOCKS) -> dict[int, int]:
    """In which block the message of each block arrives."""
    found = dict[int, int]()
    for index in range(1, blocks):
        message = NeighbourMessage(sender=sender, block=index - 1, gossip=[], channels={})
        found |= {each.block: index for each in network.deliver(index, [message])}
    return found


def test_an_ideal_network_delivers_everything_in_time() -> None:
    found = arrivals(SimulatedNetwork(receiver(LinkQuality())))
    assert found == {block: block + 1 for block in range(BLOCKS - 1)}


def test_as_many_messages_are_lost_as_was_asked_for_each_by_itself() -> None:
    network, share = SimulatedNetwork(receiver(LinkQuality(loss=0.2))), 0.2
    is_lost = np.array([block not in found for found in [arrivals(network)] for block in range(BLOCKS - 1)])
    std = np.sqrt(share * (1.0 - share) / len(is_lost))
    assert abs(is_lost.mean() - share) < 4.0 * std
    both = is_lost[1:] & is_lost[:-1]
    assert abs(both.mean() - share**2) < 4.0 * np.sqrt(share**2 / len(both))


def test_delays_are_those_of_the_scenario_in_blocks() -> None:
    block = receiver(LinkQuality()).start_of(1)
    found = arrivals(SimulatedNetwork(receiver(LinkQuality(delay=2.5 * block))))
    assert {index - sent for sent, index in found.items()} == {3}
    found = arrivals(SimulatedNetwork(receiver(LinkQuality(delay=0.58))))  # 0.58 / 0.02 is rounded to less than 29
    assert {index - sent for sent, index in found.items()} == {30}
    found = arrivals(SimulatedNetwork(receiver(LinkQuality(delay=block, jitter=3.0 * block))))
    late = np.array([index - sent - 1 for sent, index in found.items()])
    assert set(late) == {1, 2, 3}
    assert abs((late == 2).mean() - 1.0 / 3.0) < 0.05


def test_what_happens_depends_on_seed_sender_and_receiver_but_not_on_other_messages() -> None:
    quality = LinkQuality(loss=0.5)
    config = receiver(quality)
    one = arrivals(SimulatedNetwork(config))
    assert arrivals(SimulatedNetwork(config)) == one
    both = SimulatedNetwork(config)
    arrivals(both, "r3")
    assert arrivals(both) == one
    for other in (replace(config, seed=config.seed + 1), receiver(quality, "r3")):
        assert arrivals(SimulatedNetwork(other)) != one
    assert arrivals(SimulatedNetwork(config), "r3") != one


def test_a_link_can_change_and_what_is_under_way_still_arrives() -> None:
    network = SimulatedNetwork(receiver(LinkQuality(delay=0.1)))
    first = arrivals(network, blocks=6)
    network.set_link("r1", LinkQuality())
    sent = NeighbourMessage(sender="r1", block=10, gossip=[], channels={})
    arrived = [each.block for each in network.deliver(11, [sent])]
    assert first == {}
    assert arrived == [0, 1, 2, 3, 4, 10]


@pytest.mark.parametrize(
    "quality", [LinkQuality(loss=0.05), LinkQuality(delay=0.05, jitter=0.03)], ids=["loss", "delay"]
)
def test_the_default_estimator_does_not_mind_a_network_that_loses_or_delays_messages(quality: LinkQuality) -> None:
    last = {}
    for record in run_in_process(changed("ring3", duration=6.0, network=quality, load_changes=())):
        last |= record.estimates
    for estimate in last.values():
        assert estimate.status == "valid", estimate.reasons
        assert estimate.silent == []
        assert estimate.payload is not None
        assert abs(estimate.payload.mass - record.truth.payload.mass) < 0.05

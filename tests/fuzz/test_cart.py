"""Whatever a pusher of a cart says, another one refuses it with a reason, or goes on with it."""

from __future__ import annotations

from copy import deepcopy
from functools import cache

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coheft.agents.cart.agent import CartAgent
from coheft.agents.cart.process import check_content
from coheft.app.cart.inprocess import neighbours_of
from coheft.app.cart.table_one import table_one
from coheft.errors import MessageError
from coheft.wire.cart.config import agent_config
from coheft.wire.cart.messages import CartMeasurement, CartMessage
from coheft.wire.messages.codec import decode, encode
from tests.fuzz.any_message import KEY, altered, values

SCENARIO = table_one(6, pushers=2)
NEIGHBOURS = neighbours_of(SCENARIO)
ONE, OTHER = NEIGHBOURS
BLOCKS = 12


def measured(name: str, block: int) -> CartMeasurement:
    return CartMeasurement(robot=name, block=block, motion=np.zeros(6), wrench=np.zeros(3), hand=np.zeros(2))


def pushers() -> dict[str, CartAgent]:
    return {name: CartAgent(agent_config(SCENARIO, name, NEIGHBOURS[name])) for name in (ONE, OTHER)}


@cache
def under_way() -> tuple[CartAgent, CartMessage]:
    """A pusher whose sums are under way, and what the other one tells it next."""
    agents, said = pushers(), dict[str, CartMessage]()
    for block in range(BLOCKS):
        heard = {ONE: said.get(OTHER), OTHER: said.get(ONE)}
        said = {
            name: agent.step(measured(name, block), [message] if (message := heard[name]) else []).message
            for name, agent in agents.items()
        }
    return agents[ONE], said[OTHER]


def refuses(message: CartMessage) -> bool:
    """Whether a pusher does; if not, it can go on, and what it says makes sense."""
    agent = deepcopy(under_way()[0])
    try:
        check_content(message)
    except MessageError:
        return True
    for block, inbox in ((BLOCKS, [message]), (BLOCKS + 1, [])):
        outbox = agent.step(measured(ONE, block), inbox)
        decode(encode(outbox.message, KEY), CartMessage, KEY)
        assert np.isfinite(outbox.push.wrench).all()
    return False


def test_a_sound_message_is_taken_in_while_sums_are_under_way() -> None:
    message = under_way()[1]
    assert message.valid.any()
    assert not refuses(message)


@given(message=st.deferred(lambda: altered(under_way()[1])))
def test_a_sound_message_with_another_value_in_a_place(message: CartMessage) -> None:
    refuses(msgspec.structs.replace(message, sender=OTHER, block=BLOCKS - 1))


@given(message=values(CartMessage))
def test_any_message(message: CartMessage) -> None:
    refuses(msgspec.structs.replace(message, sender=OTHER, block=BLOCKS - 1))


@pytest.mark.parametrize("valid", [np.ones(()), np.ones((2, 2))])
def test_flags_of_a_wrong_shape_are_refused(valid: np.ndarray) -> None:
    message = CartMessage(sender=OTHER, block=0, gossip=[], stages=np.zeros((1, 1, 1)), valid=valid)
    with pytest.raises(MessageError, match="valid"):
        check_content(message)


def test_impossible_gossip_is_refused() -> None:
    message = pushers()[OTHER].step(measured(OTHER, 0), []).message
    check_content(message)
    (record, *_) = message.gossip
    impossible = msgspec.structs.replace(record, incarnation=2**64 - 1)
    with pytest.raises(MessageError, match=f"its record of '{OTHER}' is impossible"):
        check_content(msgspec.structs.replace(message, gossip=[impossible]))

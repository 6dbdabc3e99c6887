"""Whatever a pusher of a cart says, another one refuses it with a reason, or goes on with it."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import given

from agents.cart import CartAgent
from agents.cart_process import check_content
from coheft.app.cart.inprocess import neighbours_of
from coheft.app.cart.table_one import table_one
from coheft.errors import MessageError
from coheft.wire.cart import CartMeasurement, CartMessage, agent_config
from coheft.wire.codec import decode, encode
from tests.fuzz.any_message import KEY, values

SCENARIO = table_one(6, pushers=2)
NEIGHBOURS = neighbours_of(SCENARIO)
ONE, OTHER = NEIGHBOURS


@given(said=values(CartMessage))
def test_what_a_pusher_takes_in_it_can_go_on_with(said: CartMessage) -> None:
    agents = {name: CartAgent(agent_config(SCENARIO, name, NEIGHBOURS[name])) for name in (ONE, OTHER)}
    first = CartMeasurement(robot=ONE, block=0, motion=np.zeros(6), wrench=np.zeros(3), hand=np.zeros(2))
    heard = msgspec.structs.replace(said, sender=OTHER, block=0)
    agents[ONE].step(first, [])
    try:
        check_content(heard)
    except MessageError:
        return
    outbox = agents[ONE].step(msgspec.structs.replace(first, block=1), [heard])
    decode(encode(outbox.message, KEY), CartMessage, KEY)


@pytest.mark.parametrize("valid", [np.ones(()), np.ones((2, 2))])
def test_flags_of_a_wrong_shape_are_refused(valid: np.ndarray) -> None:
    message = CartMessage(sender=OTHER, block=0, gossip=[], stages=np.zeros((1, 1, 1)), valid=valid)
    with pytest.raises(MessageError, match="valid"):
        check_content(message)


def test_impossible_gossip_is_refused() -> None:
    agent = CartAgent(agent_config(SCENARIO, OTHER, NEIGHBOURS[OTHER]))
    own = CartMeasurement(robot=OTHER, block=0, motion=np.zeros(6), wrench=np.zeros(3), hand=np.zeros(2))
    message = agent.step(own, []).message
    check_content(message)
    (record, *_) = message.gossip
    impossible = msgspec.structs.replace(record, incarnation=2**64 - 1)
    with pytest.raises(MessageError, match=f"what it says about '{OTHER}' is impossible"):
        check_content(msgspec.structs.replace(message, gossip=[impossible]))

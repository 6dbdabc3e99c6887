"""Configurations of the processes of a run with a cart."""

import msgspec

from coheft.wire.cart.scenario import CartScenario, CartTask
from coheft.wire.config import Neighbour


class CartAgentConfig(CartTask, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All that one pusher knows at the start.

    Attributes:
        hand: Its first contact point in ``{b}`` [m].
        reach: Range of ``y`` of its hand [m].
    """

    name: str
    neighbours: tuple[str, ...]
    hand: tuple[float, float]
    reach: tuple[float, float]


class CartAgentProcessConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A pusher and its links, see ``AgentProcessConfig``."""

    agent: CartAgentConfig
    run: str
    server: str
    listen: str
    observe: str
    neighbours: tuple[Neighbour, ...]


class CartServerConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The cart's physics and its links, see ``ServerConfig``."""

    scenario: CartScenario
    run: str
    robots: dict[str, str]
    observe: str


def agent_config(scenario: CartScenario, name: str, neighbours: tuple[str, ...]) -> CartAgentConfig:
    """Configuration of one pusher."""
    task = {field: getattr(scenario, field) for field in CartTask.__struct_fields__}
    return CartAgentConfig(
        name=name, neighbours=neighbours, hand=scenario.hand(name), reach=scenario.reach(name), **task
    )

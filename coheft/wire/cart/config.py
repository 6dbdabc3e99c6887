"""What each process of a run with a cart is told when it starts: nothing more than its part needs."""

from __future__ import annotations

import msgspec

from coheft.estimation.cart.control import Tracking
from coheft.estimation.cart.prior import CartPrior
from coheft.wire.cart.scenario import CartGuess, CartScenario, TrajectoryName
from coheft.wire.config import Neighbour


class CartAgentConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All that one pusher knows when it starts: not how many they are, not the others' hands, not the cart.

    Attributes:
        name: Its own name.
        neighbours: Those it can talk with.
        guess: What it takes the cart to be.
        trajectory: Where the cart shall go.
        noise: Of its measurements of the cart's motion, see ``CartScenario``.
        force_noise: Of its hand's force sensor [N].
        slides: Whether its hand slides along the handle.
        learns: Whether it corrects its guess.
        hand: Its contact point in ``{b}`` at first [m].
        reach: Lowest and highest ``y`` that its hand may slide to [m].
        rate: Samples per second.
        lag: Samples from a measurement to the push that answers it.
        arm: What torque costs its hand [m].
        strength: Largest effort of all hands together [N].
        prior: How wrong the guess may be.
        tracking: How hard errors are fought.
    """

    name: str
    neighbours: tuple[str, ...]
    guess: CartGuess
    trajectory: TrajectoryName
    noise: float
    force_noise: float
    slides: bool
    learns: bool
    hand: tuple[float, float]
    reach: tuple[float, float]
    rate: int
    lag: int
    arm: float
    strength: float
    prior: CartPrior
    tracking: Tracking


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
    """A pusher's share of a scenario."""
    return CartAgentConfig(
        name=name,
        neighbours=neighbours,
        guess=scenario.guess,
        trajectory=scenario.trajectory,
        noise=scenario.noise,
        force_noise=scenario.force_noise,
        slides=scenario.slides,
        learns=scenario.learns,
        hand=scenario.hand(name),
        reach=scenario.reach(name),
        rate=scenario.rate,
        lag=scenario.lag,
        arm=scenario.arm,
        strength=scenario.strength,
        prior=scenario.prior,
        tracking=scenario.tracking,
    )

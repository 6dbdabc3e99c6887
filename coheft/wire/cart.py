"""What crosses process boundaries when agents push a cart: configurations and messages."""

from __future__ import annotations

from typing import Any, Literal

import msgspec
import numpy as np

from coheft.errors import ScenarioError
from coheft.estimation.cart_control import Tracking
from coheft.estimation.cart_model import CartBody
from coheft.estimation.cart_prior import CartPrior
from coheft.wire.config import Neighbour
from coheft.wire.messages import LinkState, Message

PHYSICS_RATE = 500
"""Steps of the physics per second."""


class CartGuess(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A cart, as it is or as somebody takes it to be; see ``CartBody``."""

    mass: float
    com: tuple[float, float]
    inertia: float
    friction: float

    @property
    def body(self) -> CartBody:
        """The same to compute with."""
        return CartBody(self.mass, self.com, self.inertia, self.friction)

    @staticmethod
    def of(body: CartBody) -> CartGuess:
        """The same to send."""
        return CartGuess(mass=body.mass, com=body.com, inertia=body.inertia, friction=body.friction)


class CartLoad(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A load that is dropped onto the cart, standing still over the floor before, or that is taken off as it rolls.

    Attributes:
        at: When [s].
        mass: What comes, or goes where negative [kg].
        place: Where it lies in ``{b}`` [m].
    """

    at: float
    mass: float
    place: tuple[float, float]


TrajectoryName = Literal["straight", "curves", "there and back"]


class CartScenario(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One run with a cart.

    Attributes:
        name: For people.
        cart: As it is.
        guess: As the pushers take it to be at first.
        trajectory: Where it shall go.
        noise: Standard deviation of measured positions and velocities, each component [m, rad, m/s, rad/s].
        force_noise: Standard deviation of measured forces [N]; that of torques is ``arm`` times as much.
        slides: Whether hands slide along the handle to where they push best.
        learns: Whether the pushers correct their guess.
        loads: What is put on and taken off.
        casters: Whether casters turn round, and drag meanwhile, when the cart goes the other way.
        seed: Of all noise.
        pushers: How many.
        duration: [s].
        rate: Samples, messages and pushes per second; must divide ``PHYSICS_RATE``.
        lag: Samples from a measurement to the push that answers it.
        arm: What torque costs a hand [m], see ``coheft.estimation.cart_contact``.
        strength: Largest effort of all hands together [N].
        handle: ``x`` of the handle in ``{b}`` and half its length [m].
        prior: How wrong the guess may be.
        tracking: How hard errors are fought.

    Raises:
        ScenarioError: The physics cannot sample at this rate.
    """

    name: str
    cart: CartGuess
    guess: CartGuess
    trajectory: TrajectoryName
    noise: float = 0.005
    force_noise: float = 0.0
    slides: bool = False
    learns: bool = True
    loads: tuple[CartLoad, ...] = ()
    casters: bool = False
    seed: int = 1
    pushers: int = 1
    duration: float = 30.0
    rate: int = 100
    lag: int = 2
    arm: float = 0.1
    strength: float = 150.0
    handle: tuple[float, float] = (-0.25, 0.3)
    prior: CartPrior = CartPrior()
    tracking: Tracking = Tracking()

    def __post_init__(self) -> None:
        allowed = [rate for rate in range(1, PHYSICS_RATE + 1) if PHYSICS_RATE % rate == 0]
        if self.rate not in allowed:
            raise ScenarioError(
                f"cart scenario {self.name!r}: key 'rate': found {self.rate}, expected one of "
                f"{', '.join(map(str, allowed))}: those that divide the {PHYSICS_RATE} steps of the physics per second"
            )

    @property
    def blocks(self) -> int:
        """Number of samples."""
        return round(self.duration * self.rate)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the pushers."""
        return tuple(f"p{i + 1}" for i in range(self.pushers))

    def reach(self, name: str) -> tuple[float, float]:
        """Between which ``y`` on the handle a pusher's hand may be [m]: they divide it among them."""
        _, half = self.handle
        width = 2.0 * half / self.pushers
        low = -half + self.names.index(name) * width
        return low, low + width

    def hand(self, name: str) -> tuple[float, float]:
        """Where a pusher takes hold in ``{b}`` [m]: in the middle of its reach."""
        low, high = self.reach(name)
        return self.handle[0], 0.5 * (low + high)


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


# --- robot plane -------------------------------------------------------------------------------------------------


class CartMeasurement(Message, frozen=True):
    """Server to pusher: its own sensors' sample.

    Attributes:
        robot: Whose.
        block: Number of the sample; it was taken ``block / rate`` seconds after the start.
        motion: ``(q, qd)`` of the cart at that time, shape (6,).
        wrench: What its hand did from then until the next sample, about its contact point, axes of ``{b}``, shape (3,).
        hand: Where in ``{b}`` it did so, shape (2,) [m].
    """

    robot: str
    block: int
    motion: np.ndarray[Any, Any]
    wrench: np.ndarray[Any, Any]
    hand: np.ndarray[Any, Any]


class CartPush(Message, frozen=True):
    """Pusher to server: the answer to one sample, and what its hand shall do ``lag`` samples later.

    Attributes:
        robot: Whose.
        block: From this sample to the next it shall hold.
        answers: The sample that this answers.
        wrench: About the contact point, axes of ``{b}``, shape (3,).
        hand: The contact point in ``{b}``, shape (2,) [m].
    """

    robot: str
    block: int
    answers: int
    wrench: np.ndarray[Any, Any]
    hand: np.ndarray[Any, Any]


# --- neighbour plane ---------------------------------------------------------------------------------------------


class CartMessage(Message, frozen=True):
    """Pusher to each neighbour, once per sample.

    Attributes:
        sender: Who speaks.
        block: The sample after which it was sent.
        gossip: News about pushers.
        stages: Values under way in the network's sums, see ``consensus.pipeline``, shape (K, 1, C); empty before.
        valid: Which of them are complete so far, 0 or 1, shape (K,).
    """

    sender: str
    block: int
    gossip: list[LinkState]
    stages: np.ndarray[Any, Any]
    valid: np.ndarray[Any, Any]


# --- observer plane ----------------------------------------------------------------------------------------------


class CartEstimate(Message, frozen=True):
    """What one pusher believes.

    Attributes:
        robot: Whose belief.
        block: The last sample that it had seen.
        time: When that was taken [s].
        members: Number of pushers as learned by gossip.
        cart: What it takes the cart to be.
        covariance: Of ``(m, d_x, d_y, I, sigma)``, shape (5, 5).
        not_known: Quantities that the motion has not shown, and what would show them.
        jumps: How many sudden changes it has noticed.
        problems: Messages refused so far.
    """

    robot: str
    block: int
    time: float
    members: int
    cart: CartGuess
    covariance: np.ndarray[Any, Any]
    not_known: dict[str, str]
    jumps: int
    problems: int = 0


class CartTruth(Message, frozen=True):
    """Server to observers; no pusher can read it.

    Attributes:
        block: Number of the sample.
        time: When it was taken [s].
        cart: As it is.
        motion: ``(q, qd)``, shape (6,).
        wrench: Of all hands together about the origin of ``{b}``, in its axes, from then on, shape (3,).
        effort: Root of the sum over hands of ``f^2 + (tau / arm)^2`` [N].
        slip: Sideways velocity of the wheels [m/s].
    """

    block: int
    time: float
    cart: CartGuess
    motion: np.ndarray[Any, Any]
    wrench: np.ndarray[Any, Any]
    effort: float
    slip: float

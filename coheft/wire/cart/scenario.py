"""Scenarios of a cart: what is pushed, by whom, where to, and what happens to it."""

from __future__ import annotations

from typing import Literal

import msgspec

from coheft.errors import ScenarioError
from coheft.estimation.cart.control import Tracking
from coheft.estimation.cart.model import CartBody
from coheft.estimation.cart.prior import CartPrior

PHYSICS_RATE = 500
"""Steps of the physics per second."""


class CartLoad(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A load that is dropped onto the cart, standing still over the floor before, or that is taken off as it rolls.

    Attributes:
        at: When [s].
        mass: What comes, or goes where negative [kg].
        place: Where its middle lies in ``{b}`` [m].
        size: Length and width of a box, filled evenly, whose sides are along the cart's [m]; a point mass without.
    """

    at: float
    mass: float
    place: tuple[float, float]
    size: tuple[float, float] = (0.0, 0.0)


TrajectoryName = Literal["straight", "curves", "there and back"]


class CartTask(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What the pushers of a cart are told of a run: not how many they are, not the cart as it is.

    Attributes:
        guess: What they take the cart to be at first.
        trajectory: Where it shall go.
        noise: Standard deviation of measured positions and velocities, each component [m, rad, m/s, rad/s].
        force_noise: Standard deviation of measured forces [N]; that of torques is ``arm`` times as much.
        slides: Whether hands slide along the handle to where they push best.
        learns: Whether the pushers correct their guess.
        rate: Samples, messages and pushes per second; must divide ``PHYSICS_RATE``.
        lag: Samples from a measurement to the push that answers it.
        arm: What torque costs a hand [m], see ``coheft.estimation.cart.contact``.
        strength: Largest effort of all hands together [N].
        prior: How wrong the guess may be.
        tracking: How hard errors are fought.
    """

    guess: CartBody
    trajectory: TrajectoryName
    noise: float = 0.005
    force_noise: float = 0.0
    slides: bool = False
    learns: bool = True
    rate: int = 100
    lag: int = 2
    arm: float = 0.1
    strength: float = 150.0
    prior: CartPrior = CartPrior()
    tracking: Tracking = Tracking()


class CartScenario(CartTask, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One run with a cart.

    Attributes:
        name: For people.
        cart: As it is.
        noise_factor: The noise is so many times what the pushers are told.
        loads: What is put on and taken off.
        casters: Whether casters turn round, and drag meanwhile, when the cart goes the other way.
        seed: Of all noise.
        pushers: How many.
        duration: [s].
        handle: ``x`` of the handle in ``{b}`` and half its length [m].

    Raises:
        ScenarioError: The physics cannot sample at this rate.
    """

    name: str
    cart: CartBody
    noise_factor: float = 1.0
    loads: tuple[CartLoad, ...] = ()
    casters: bool = False
    seed: int = 1
    pushers: int = 1
    duration: float = 30.0
    handle: tuple[float, float] = (-0.25, 0.3)

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

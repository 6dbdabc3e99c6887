"""Scenarios of a cart that is pushed."""

from typing import Literal

import msgspec

from coheft.errors import ScenarioError
from coheft.estimation.cart.control import Tracking
from coheft.estimation.cart.model import CartBody
from coheft.estimation.cart.prior import CartPrior

PHYSICS_RATE = 500
"""Steps of the physics per second."""


class CartLoad(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A load that is added at rest, or removed while the cart rolls.

    Attributes:
        at: Time [s].
        mass: Mass that is added; negative if it is removed [kg].
        place: Position of its centre in ``{b}`` [m].
        size: Length and width of a homogeneous box with the cart's axes [m]; zero for a point mass.
    """

    at: float
    mass: float
    place: tuple[float, float]
    size: tuple[float, float] = (0.0, 0.0)


TrajectoryName = Literal["straight", "curves", "there and back"]


class CartTask(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The part of a scenario that the pushers know: neither their number, nor the true cart.

    Attributes:
        guess: Their first guess of the cart.
        trajectory: Reference trajectory.
        noise: Standard deviation of measured positions and velocities, each component [m, rad, m/s, rad/s].
        force_noise: Standard deviation of measured forces [N]; that of torques is ``arm`` times as large.
        slides: Whether hands slide along the handle to their best contact points.
        learns: Whether the pushers use the estimator.
        rate: Samples, messages and pushes per second; must divide ``PHYSICS_RATE``.
        lag: Number of samples from a measurement to the push that answers it.
        arm: Ratio of a hand's costs of force and torque [m], see ``coheft.estimation.cart.contact``.
        strength: Largest effort of all hands together [N].
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
        noise_factor: True noise of the motion in multiples of ``noise``.
        casters: Whether casters turn around, with drag, when the cart reverses.
        duration: Duration [s].
        handle: ``x`` of the handle in ``{b}``, and half its length [m].

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
        """Names of the pushers."""
        return tuple(f"p{i + 1}" for i in range(self.pushers))

    def reach(self, name: str) -> tuple[float, float]:
        """Range of ``y`` of a pusher's hand on the handle, which the pushers share equally [m]."""
        _, half = self.handle
        width = 2.0 * half / self.pushers
        low = -half + self.names.index(name) * width
        return low, low + width

    def hand(self, name: str) -> tuple[float, float]:
        """First contact point of a pusher in ``{b}``, the middle of its range [m]."""
        low, high = self.reach(name)
        return self.handle[0], 0.5 * (low + high)

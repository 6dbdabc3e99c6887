"""All messages of a run with a cart."""

from typing import Any

import numpy as np

from coheft.estimation.cart.model import CartBody
from coheft.wire.messages.structs import LinkState, Message, sent_as

# --- robot plane -------------------------------------------------------------------------------------------------


@sent_as(50, block="block")
class CartMeasurement(Message, frozen=True):
    """Server to pusher: a sample of its sensors.

    Attributes:
        block: Number of the sample, ``block / rate`` seconds after the start.
        motion: ``(q, qd)`` of the cart at that time: pose of ``{b}`` in ``{s}`` and its rate, shape (6,) [m, m, rad,
            m/s, m/s, rad/s].
        wrench: Wrench of its hand from then until the next sample, about its contact point, axes of ``{b}``, shape (3,)
            [N, N, N·m].
        hand: Its contact point in ``{b}``, shape (2,) [m].
    """

    robot: str
    block: int
    motion: np.ndarray[Any, Any]
    wrench: np.ndarray[Any, Any]
    hand: np.ndarray[Any, Any]


@sent_as(51, block="block", number="answers")
class CartPush(Message, frozen=True):
    """Pusher to server: the answer to a sample, with the wrench of its hand ``lag`` samples later.

    Attributes:
        block: The sample from which to the next the push holds.
        wrench: Wrench about the contact point, axes of ``{b}``, shape (3,) [N, N, N·m].
        hand: The contact point in ``{b}``, shape (2,) [m].
    """

    robot: str
    block: int
    answers: int
    wrench: np.ndarray[Any, Any]
    hand: np.ndarray[Any, Any]


# --- neighbour plane ---------------------------------------------------------------------------------------------


@sent_as(52, block="block")
class CartMessage(Message, frozen=True):
    """Pusher to each neighbour, once per sample.

    Attributes:
        block: The sample after which it was sent.
        stages: Partial sums, see ``coheft.consensus.pipeline``, shape (K, 1, C); empty before the sums begin.
        valid: Which of them are complete, 0 or 1, shape (K,).
    """

    sender: str
    block: int
    gossip: list[LinkState]
    stages: np.ndarray[Any, Any]
    valid: np.ndarray[Any, Any]


# --- observer plane ----------------------------------------------------------------------------------------------


@sent_as(53, block="block")
class CartEstimate(Message, frozen=True):
    """Estimate of one pusher, to observers.

    Attributes:
        block: The last sample that it has processed.
        members: Number of pushers according to gossip.
        covariance: Of ``(m, d_x, d_y, I, sigma)``, shape (6, 6), in the squares of the units of ``CartBody``.
        not_known: Quantities that the motion has not shown, and what would show them.
        doubts: What is measured worse than stated, as sentences.
    """

    robot: str
    block: int
    time: float
    members: int
    cart: CartBody
    covariance: np.ndarray[Any, Any]
    not_known: dict[str, str]
    jumps: int
    doubts: list[str]
    problems: int = 0


@sent_as(54, block="block")
class CartTruth(Message, frozen=True):
    """Server to observers: the truth, which pushers cannot read.

    Attributes:
        motion: ``(q, qd)``: pose of ``{b}`` in ``{s}`` and its rate, shape (6,) [m, m, rad, m/s, m/s, rad/s].
        wrench: Total wrench of all hands from then on about the origin of ``{b}``, in its axes, shape (3,) [N, N, N·m].
        effort: Root of the sum over hands of ``f^2 + (tau / arm)^2`` [N].
        slip: Sideways velocity of the wheels [m/s].
    """

    block: int
    time: float
    cart: CartBody
    motion: np.ndarray[Any, Any]
    wrench: np.ndarray[Any, Any]
    effort: float
    slip: float

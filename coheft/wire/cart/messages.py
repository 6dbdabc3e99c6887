"""Every message of a run with a cart that crosses a process boundary."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from coheft.estimation.cart.model import CartBody
from coheft.wire.messages.structs import LinkState, Message

# --- robot plane -------------------------------------------------------------------------------------------------


class CartMeasurement(Message, frozen=True):
    """Server to pusher: its own sensors' sample.

    Attributes:
        robot: Whose.
        block: Number of the sample; it was taken ``block / rate`` seconds after the start.
        motion: ``(q, qd)`` of the cart at that time: pose of ``{b}`` in ``{s}`` and its rate, shape (6,) [m, m, rad,
            m/s, m/s, rad/s].
        wrench: What its hand did from then until the next sample, about its contact point, axes of ``{b}``, shape (3,)
            [N, N, N·m].
        hand: Where in ``{b}`` it did so, shape (2,) [m].
    """

    code: ClassVar[int] = 50
    in_header: ClassVar[tuple[str | None, str | None]] = ("block", None)
    is_steady: ClassVar[bool] = True

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
        wrench: About the contact point, axes of ``{b}``, shape (3,) [N, N, N·m].
        hand: The contact point in ``{b}``, shape (2,) [m].
    """

    code: ClassVar[int] = 51
    in_header: ClassVar[tuple[str | None, str | None]] = ("block", "answers")
    is_steady: ClassVar[bool] = True

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
        stages: Values under way in the network's sums, see ``coheft.consensus.pipeline``, shape (K, 1, C);
            empty before.
        valid: Which of them are complete so far, 0 or 1, shape (K,).
    """

    code: ClassVar[int] = 52
    in_header: ClassVar[tuple[str | None, str | None]] = ("block", None)
    is_steady: ClassVar[bool] = True

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
        covariance: Of ``(m, d_x, d_y, I, sigma)``, shape (6, 6), in the squares of the units of ``CartBody``.
        not_known: Quantities that the motion has not shown, and what would show them.
        jumps: How many sudden changes it has noticed.
        doubts: What is measured worse than it was told, in words.
        problems: Messages refused so far.
    """

    code: ClassVar[int] = 53
    in_header: ClassVar[tuple[str | None, str | None]] = ("block", None)

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


class CartTruth(Message, frozen=True):
    """Server to observers; no pusher can read it.

    Attributes:
        block: Number of the sample.
        time: When it was taken [s].
        cart: As it is.
        motion: ``(q, qd)``: pose of ``{b}`` in ``{s}`` and its rate, shape (6,) [m, m, rad, m/s, m/s, rad/s].
        wrench: Of all hands together about the origin of ``{b}``, in its axes, from then on, shape (3,) [N, N, N·m].
        effort: Root of the sum over hands of ``f^2 + (tau / arm)^2`` [N].
        slip: Sideways velocity of the wheels [m/s].
    """

    code: ClassVar[int] = 54
    in_header: ClassVar[tuple[str | None, str | None]] = ("block", None)

    block: int
    time: float
    cart: CartBody
    motion: np.ndarray[Any, Any]
    wrench: np.ndarray[Any, Any]
    effort: float
    slip: float

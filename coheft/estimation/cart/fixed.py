"""The other side of the comparison: a pusher who never doubts its first guess of the cart."""

from __future__ import annotations

import numpy as np

from coheft.estimation.cart.filter import MOTION_SIZE, Push, Sighting, move
from coheft.estimation.cart.model import CartBody
from coheft.estimation.geometry.spatial import Array


class FixedCart:
    """Takes the cart to be what was guessed, and its motion to be what was measured last.

    A filter with a wrong model that it believes in would only spoil what is measured.

    Args:
        guess: The cart.

    Attributes:
        body: The guess.
        jumps: 0: it notices nothing.
        is_judged: Never: it does not look.
    """

    def __init__(self, guess: CartBody) -> None:
        self.body = guess
        self.jumps = 0
        self.is_judged = False
        self._state = np.zeros(MOTION_SIZE)

    def body_covariance(self) -> Array:
        """Of ``(m, d_x, d_y, I, sigma)``, shape (6, 6): it claims to know."""
        return np.zeros((6, 6))

    def doubts(self) -> list[str]:
        """None."""
        return []

    def step(self, sighting: Sighting, push: Push) -> None:
        """Take in a measurement, and what the hands did from then on."""
        self._state = sighting.motion
        self.coast(push)

    def coast(self, push: Push) -> None:
        """A push without a measurement before it."""
        self._state = self.ahead([push.wrench_b], push.duration)

    def ahead(self, wrenches_b: list[Array], duration: float) -> Array:
        """``(q, qd)`` after further steps with these wrenches, each of ``duration`` [s]."""
        state = np.concatenate([self._state, self.body.parameters])
        for wrench_b in wrenches_b:
            state = move(state, wrench_b, duration)
        return state[:MOTION_SIZE]

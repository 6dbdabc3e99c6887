"""The comparison without an estimator: a pusher that keeps its first guess of the cart."""

import numpy as np

from coheft.estimation.cart.filter import MOTION_SIZE, MotionMeasurement, Push, ahead
from coheft.estimation.cart.model import CartBody
from coheft.estimation.geometry.spatial import Array


class FixedCart:
    """Has the methods of ``CartLearner``, but keeps the guess; the motion is the last measured one, not filtered."""

    def __init__(self, guess: CartBody) -> None:
        self.body = guess
        self.jumps = 0
        self.is_judged = False
        self._state = np.zeros(MOTION_SIZE)

    def body_covariance(self) -> Array:
        """Covariance of ``(m, d_x, d_y, I, sigma)``, shape (6, 6): zero."""
        return np.zeros((6, 6))

    def doubts(self) -> list[str]:
        """Always empty."""
        return []

    def step(self, measurement: MotionMeasurement, push: Push) -> None:
        """Process a measurement, and the push after it."""
        self._state = measurement.motion
        self.coast(push)

    def coast(self, push: Push) -> None:
        """Process a push without a measurement."""
        self._state = self.ahead([push.wrench_b], push.duration)

    def ahead(self, wrenches_b: list[Array], duration: float) -> Array:
        """Predict ``(q, qd)`` after steps with these wrenches, of ``duration`` [s] each."""
        return ahead(np.concatenate([self._state, self.body.parameters]), wrenches_b, duration)

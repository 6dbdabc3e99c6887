"""One pusher of a cart as a pure core: takes its own sample and its neighbours' messages, returns messages and a push.

Every pusher measures the wrench of its own hand only, but the cart's motion depends on all of them. So the pushers sum
their wrenches and measurements, exactly and a few samples late. Then each filters the same numbers, obtains the same
cart and the same total push, and exerts its share of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coheft.agents.cart.sums import CartSums, Lost, Totals
from coheft.consensus.gossip import Gossip
from coheft.estimation.cart.contact import BestContact, effort, grasp_map, leverage, share
from coheft.estimation.cart.control import Tracker
from coheft.estimation.cart.filter import MOTION_SIZE, MotionMeasurement, Push
from coheft.estimation.cart.fixed import FixedCart
from coheft.estimation.cart.learner import CartLearner
from coheft.estimation.cart.observability import not_known
from coheft.estimation.cart.trajectory import TRAJECTORIES
from coheft.estimation.geometry.spatial import Array
from coheft.wire.cart.config import CartAgentConfig
from coheft.wire.cart.messages import CartEstimate, CartMeasurement, CartMessage, CartPush

_REPORT_INTERVAL = 0.1
"""Time between reports to observers [s]."""
_SLIDING = 0.1
"""Speed at which a hand slides along the handle [m/s]."""
_MEMORY = 2.0
"""Time over which pushes are averaged to find a hand's best position [s]."""
_UNKNOWN_WRENCH = 10.0
"""Standard deviation of a lost total from the planned one [N, N·m]."""


@dataclass(frozen=True, eq=False)
class CartOutbox:
    """Messages of a pusher after a sample: to its neighbours, to the server, and sometimes to observers."""

    message: CartMessage
    push: CartPush
    estimate: CartEstimate | None


class CartAgent:
    """One pusher of a cart."""

    def __init__(self, config: CartAgentConfig) -> None:
        self.config = config
        self._period = 1.0 / config.rate
        self._gossip = Gossip(config.name, config.neighbours)
        self._sums = CartSums(config.name, self._gossip)
        self._tracker = Tracker(config.tracking)
        self._trajectory = TRAJECTORIES[config.trajectory]
        self._best_contact = BestContact(_MEMORY * config.rate)
        self._hand = np.array(config.hand)
        self._planned: dict[int, Array] = {}
        self._knowledge: CartLearner | FixedCart | None = None
        self._newest: Totals | None = None
        self._reached = 0

    def step(self, measurement: CartMeasurement, inbox: Sequence[CartMessage]) -> CartOutbox:
        """Process one sample, with the neighbours' messages after the previous one."""
        index = measurement.block
        for message in sorted(inbox, key=lambda message: message.sender):
            self._gossip.hear(message.gossip)
        wrench_b = grasp_map(measurement.hand) @ measurement.wrench
        lever = leverage(measurement.hand, self.config.arm)
        match self._sums.step(index, wrench_b, lever, measurement.motion, inbox):
            case Totals() as totals:
                self._update(totals)
            case Lost(block):
                self._predict(block)
        push = self._push(index)
        report_every = max(1, round(_REPORT_INTERVAL * self.config.rate))
        return CartOutbox(
            message=CartMessage(
                sender=self.config.name,
                block=index,
                gossip=self._gossip.news(),
                stages=self._sums.stages,
                valid=self._sums.valid,
            ),
            push=push,
            estimate=self._estimate(index) if index % report_every == 0 else None,
        )

    def _update(self, totals: Totals) -> None:
        """Update the knowledge of the cart with the sums over all pushers."""
        config = self.config
        measurement = MotionMeasurement(totals.motion, config.noise**2 / totals.members * np.eye(MOTION_SIZE))
        planned = self._planned.get(totals.block, totals.wrench_b)
        push = Push(totals.wrench_b, config.force_noise**2 * totals.leverage, self._period, planned)
        if self._knowledge is None:
            guess = config.guess
            self._knowledge = CartLearner(guess, measurement, config.prior) if config.learns else FixedCart(guess)
        self._knowledge.step(measurement, push)
        self._newest = totals
        self._reached = totals.block + 1

    def _predict(self, block: int) -> None:
        """Predict over a sample whose totals were lost, assuming the planned push."""
        if self._knowledge is not None:
            planned = self._planned.get(block, np.zeros(3))
            self._knowledge.coast(Push(planned, _UNKNOWN_WRENCH**2 * np.eye(3), self._period, planned))
            self._reached = block + 1

    def _push(self, index: int) -> CartPush:
        """Return what the pusher's own hand shall do ``lag`` samples later."""
        config, block = self.config, index + self.config.lag
        wrench = np.zeros(3)
        if self._knowledge is not None and self._newest is not None:
            ahead = [self._planned.get(k, np.zeros(3)) for k in range(self._reached, block)]
            motion = self._knowledge.ahead(ahead, self._period)
            target = self._trajectory.at(block * self._period)
            total = self._tracker.push(target, motion, self._knowledge.body)
            total *= config.strength / max(effort(total, self._newest.leverage), config.strength)
            self._slide(total)
            wrench = share(total, self._hand, config.arm, self._newest.leverage)
            self._planned[block] = total
            self._planned.pop(self._reached - 1, None)
        return CartPush(robot=config.name, block=block, answers=index, wrench=wrench, hand=self._hand.copy())

    def _slide(self, total: Array) -> None:
        """Move the hand towards the position at which this push takes the least effort."""
        best = self._best_contact.after(total)
        if self.config.slides and best is not None:
            low, high = self.config.reach
            way = min(max(best, low), high) - self._hand[1]
            self._hand[1] += min(max(way, -_SLIDING * self._period), _SLIDING * self._period)

    def _estimate(self, index: int) -> CartEstimate | None:
        if self._knowledge is None or self._newest is None:
            return None
        covariance = self._knowledge.body_covariance()
        return CartEstimate(
            robot=self.config.name,
            block=index,
            time=index * self._period,
            members=self._newest.members,
            cart=self._knowledge.body,
            covariance=covariance,
            not_known=not_known(covariance, is_judged=self._knowledge.is_judged) if self.config.learns else {},
            jumps=self._knowledge.jumps,
            doubts=self._knowledge.doubts(),
        )

"""Identifies a cart while it is pushed: an extended Kalman filter that repeats its last steps about better estimates.

Accelerations are linear in the inverse of the parameters, not in the parameters. A filter that starts with half the
mass is linearised about wrong parameters at first, and becomes overconfident, also of what is not observable yet. So
the steps of the last seconds are kept; when the parameters have changed, these steps are repeated, all of them
linearised about the present parameters.
"""

from collections import deque
from dataclasses import dataclass, field, replace
from itertools import islice
from math import cos, hypot, inf, sin, sqrt

import numpy as np

from coheft.estimation.cart.contact import MOVING
from coheft.estimation.cart.filter import (
    INNOVATION_SIZE,
    MOTION_SIZE,
    PARAMETERS,
    Belief,
    MotionMeasurement,
    Prediction,
    Push,
    Update,
    ahead,
    predict,
    smooth,
    update,
)
from coheft.estimation.cart.jump import USUAL_OF, WINDOWS, JumpTest
from coheft.estimation.cart.linearisation import FRICTION, PHI, POSE, RATES, STATE_SIZE
from coheft.estimation.cart.load import UnknownLoad
from coheft.estimation.cart.model import CartBody, axes
from coheft.estimation.cart.noise import LEAST, WhiteNoise, doubts, misfit
from coheft.estimation.cart.prior import CartPrior, nearest_possible
from coheft.estimation.geometry.spatial import Array

_KEPT = 600
"""Number of newest steps that are kept."""
_MOVED = 0.01
"""Relative change of the parameters after which steps are repeated."""
_SURELY = 2.0
"""Standard deviations by which the speed has to exceed a limit."""
_VAGUE = 1e3
"""Initial covariance of the pose, in multiples of the first measurement's."""
_NOTHING = 1e6
"""Variance of a missing measurement, of poses [m², rad²] and rates [m²/s², rad²/s²]."""
_LEAST_NEWS = 4
"""If the cart is known, steps are repeated only when at least one in this number is new."""
_FIRST = 200
"""Number of steps with corrections after which a cart counts as known."""
_JUDGED_EVERY = 25
"""Number of steps between two tests of the innovations,"""
_TOO_NEW = 16
"""number of newest steps that are left out of the test, because the cart may just have changed,"""
_LEAST_JUDGED = 64
"""and least number of steps for a test."""
_MOST_MISFIT, _LITTLE_MISFIT = 10.0, 3.0
"""Noise of the motion larger than the first multiple is ascribed to an unknown wrench, if then below the second."""
_UNKNOWN_WRENCHES = (0.3, 1.0, 3.0, 10.0)
"""Standard deviations of the unknown force that are tried [N]."""
_LEVER = 0.2
"""Ratio of the unknown torque to the unknown force [m]."""
_GROWN = 3
"""If the cart is unknown, steps are repeated when one in this number is new."""


@dataclass(eq=False)
class _Step:
    """A measurement, then a push; its results are set when it is done.

    Attributes:
        corrects_cart: Whether the cart was fast enough to correct its parameters.
        levels: White noise of the measurement in multiples of the stated one, shape (6,).
        before: Belief before the step.
    """

    measurement: MotionMeasurement
    push: Push
    corrects_cart: bool
    levels: Array
    before: Belief
    update: Update = field(init=False)
    prediction: Prediction = field(init=False)

    @property
    def surprise(self) -> float:
        """Squared innovation; 0 if the step did not correct the cart, as what casters do is no change of it."""
        return self.update.surprise if self.corrects_cart else 0.0


@dataclass(frozen=True, eq=False)
class _Change:
    """A load that has been added or removed."""

    before: Belief
    load: UnknownLoad

    def start(self) -> Belief:
        """Belief after the change."""
        mean, covariance = self.before.mean.copy(), self.before.covariance.copy()
        mean[PHI], covariance[PHI, PHI] = self.load.start()
        return Belief(mean, covariance)


class CartLearner:
    """Estimate of a cart's state and parameters.

    An iterated extended Kalman smoother over the last steps, after the iterated linear filter-smoother of Jazwinski,
    "Stochastic Processes and Filtering Theory" (1970). Each repetition of the steps is one step of Gauss-Newton (Bell,
    "The iterated Kalman smoother as a Gauss-Newton method", 1994).

    Attributes:
        belief: Belief about state and parameters after the last push.
        jumps: Number of sudden changes so far.
        is_judged: Whether innovations have been compared with the model.
    """

    def __init__(self, guess: CartBody, first: MotionMeasurement, prior: CartPrior) -> None:
        self._prior = prior
        self._least = prior.least * guess.mass, prior.least * guess.inertia
        parameters = prior.covariance(guess)
        self._drift = prior.drift**2 * parameters
        covariance = np.zeros((STATE_SIZE, STATE_SIZE))
        covariance[POSE, POSE] = _VAGUE * first.covariance[POSE, POSE]
        covariance[RATES, RATES] = prior.start**2 * np.eye(3)
        covariance[PARAMETERS, PARAMETERS] = parameters
        self.belief = Belief(np.concatenate([first.motion[:3], np.zeros(3), guess.parameters]), covariance)
        self.jumps = 0
        force, torque = prior.drag
        self._drag = np.diag(np.square([force, force, torque]))
        self._direction = 0.0
        self._rolled = inf
        self._steps: deque[_Step] = deque(maxlen=_KEPT)
        self._linearised_at = self._parameters
        self._news = 0
        self._corrections = 0
        self._unchanged = LEAST  # steps since the last change, or that many
        self._change: _Change | None = None
        self._white_noise = WhiteNoise()
        self._jump_test = JumpTest(INNOVATION_SIZE)
        self._misfit = np.ones(MOTION_SIZE)
        self._unknown_wrench = 0.0
        self._judged = 0
        self.is_judged = False

    @property
    def body(self) -> CartBody:
        """The cart, as estimated."""
        parameters = self._parameters
        return CartBody.of(parameters[:4], (float(parameters[4]), float(parameters[5])))

    def body_covariance(self) -> Array:
        """Covariance of ``(m, d_x, d_y, I, sigma)``, shape (6, 6)."""
        inverse = np.eye(6)
        inverse[:4, :4] = np.linalg.inv(self.body.phi_derivative())
        return inverse @ self.belief.covariance[PARAMETERS, PARAMETERS] @ inverse.T

    def doubts(self) -> list[str]:
        """What is measured worse than stated, as sentences; covariances allow for it already."""
        return doubts(self._white_noise.levels * self._misfit, self._unknown_wrench)

    def ahead(self, wrenches_b: list[Array], duration: float) -> Array:
        """Predict ``(q, qd)`` after steps with these wrenches, of ``duration`` [s] each."""
        state = self.belief.mean.copy()
        state[PARAMETERS] = self._parameters
        return ahead(state, wrenches_b, duration)

    def step(self, measurement: MotionMeasurement, push: Push) -> None:
        """Process a measurement, and the push after it."""
        self._take_in(measurement, push, is_louder=self._white_noise.see(measurement))

    def coast(self, push: Push) -> None:
        """Process a push without a measurement."""
        nothing = MotionMeasurement(self.belief.mean[:MOTION_SIZE], _NOTHING * np.eye(MOTION_SIZE))
        self._take_in(nothing, push, is_louder=False)

    def _take_in(self, measurement: MotionMeasurement, push: Push, *, is_louder: bool) -> None:
        """Process one step; ``is_louder`` if white noise has risen."""
        is_fast = self._is_fast()
        casters_turn = self._casters_turn(push.duration, is_fast=is_fast)
        if casters_turn:
            push = replace(push, covariance=push.covariance + self._drag)
        step = _Step(measurement, push, is_fast and not casters_turn, self._white_noise.levels, self.belief)
        if len(self._steps) == _KEPT:
            self._change = None  # its step is no longer kept
        self._steps.append(step)
        self._corrections += step.corrects_cart
        self._news += step.corrects_cart
        self._do(step)
        self._judged += 1
        if self._judged >= _JUDGED_EVERY:
            self._judge()
        since = self._changed_since()
        is_louder = is_louder or (since > 0 and self._white_noise.is_new())
        self._unchanged += 1
        may_have_changed = self._unchanged >= LEAST  # right after a change, noise looks like another one
        if is_louder:
            for recent in islice(reversed(self._steps), self._white_noise.seen):
                recent.levels = np.maximum(recent.levels, self._white_noise.levels)
        if (since and may_have_changed) or is_louder or self._is_due():
            self._do_again()
            since = self._changed_since()
        if since and may_have_changed:
            self._expect_another_cart(since)

    @property
    def _parameters(self) -> Array:
        """Estimated ``(phi, sigma)``, shape (6,), limited to possible carts."""
        phi = nearest_possible(self.belief.mean[PHI], *self._least)
        return np.concatenate([phi, np.maximum(self.belief.mean[FRICTION], 0.0)])

    def _point(self, state: Array) -> Array:
        """Point of linearisation: this motion, and the parameters of all linearisations."""
        return np.concatenate([state[:MOTION_SIZE], self._linearised_at])

    def _is_fast(self) -> bool:
        """Whether the cart surely is fast enough for the model to hold."""
        velocity = self.belief.mean[3:5]
        speed = hypot(*velocity.tolist())
        variance = float(velocity @ self.belief.covariance[3:5, 3:5] @ velocity)  # times the squared speed
        return speed * speed >= self._prior.slow * speed + _SURELY * sqrt(max(variance, 0.0))

    def _casters_turn(self, duration: float, *, is_fast: bool) -> bool:
        """Whether casters turn around, a short way after the cart has reversed; advances by a step [s]."""
        theta, x_rate, y_rate = self.belief.mean[2:5].tolist()
        speed = cos(theta) * x_rate + sin(theta) * y_rate
        if is_fast and speed * self._direction < 0.0:
            self._rolled = 0.0
        if is_fast:
            self._direction = speed
        self._rolled += abs(speed) * duration
        return self._rolled < self._prior.turning

    def _do(self, step: _Step, smoothed: Array | None = None) -> None:
        """Filter one step, linearised at the present belief, or at a smoothed state."""
        step.before = self.belief
        at = self._point(self.belief.mean if smoothed is None else smoothed)
        levels = step.levels * self._misfit
        measurement = replace(step.measurement, covariance=step.measurement.covariance * np.outer(levels, levels))
        step.update = update(self.belief, measurement, self._prior.slip, at, corrects_cart=step.corrects_cart)
        if smoothed is None:
            at = self._point(step.update.belief.mean)
        force, torque = self._unknown_wrench**2, (_LEVER * self._unknown_wrench) ** 2
        push = replace(step.push, covariance=step.push.covariance + np.diag([force, force, torque]))
        step.prediction = predict(step.update.belief, push, self._drift, at)
        self.belief = step.prediction.belief

    def _do_again(self) -> None:
        """Repeat all kept steps, linearised at the newest parameters and at the smoothed motion."""
        self._linearised_at = self._parameters
        self._news = 0
        smoothed = smooth([(step.update, step.prediction) for step in self._steps])
        if self._change is None:
            self.belief = self._steps[0].before
        else:
            self._change.load.learn(self.belief.mean[PHI], self.belief.covariance[PHI, PHI])
            self.belief = self._change.start()
        for step, state in zip(self._steps, smoothed, strict=True):
            self._do(step, state)

    def _judge(self) -> None:
        """Increase the noise of the motion if innovations are too large, or if much too large, that of the wrench."""
        self._judged = 0
        found = self._found_misfit()
        if found is None:
            return
        self.is_judged = True
        before, self._misfit = self._misfit, found
        if found.max() > _MOST_MISFIT:
            for unknown in _UNKNOWN_WRENCHES:
                if unknown > self._unknown_wrench:
                    self._unknown_wrench, self._misfit = unknown, np.ones(MOTION_SIZE)
                    self._do_again()
                    found = self._found_misfit()
                    if found is None or found.max() < _LITTLE_MISFIT:
                        return
        elif (found > before).any():
            self._do_again()

    def _found_misfit(self) -> Array | None:
        """Misfit of all innovations but the newest; None if they are too few."""
        old = islice(self._steps, max(0, len(self._steps) - _TOO_NEW))
        innovations = [step.update.innovation for step in old if step.corrects_cart]
        return misfit(np.array(innovations), self._misfit) if len(innovations) >= _LEAST_JUDGED else None

    def _is_due(self) -> bool:
        """Whether to repeat the steps: enough are new, and parameters have changed or were unknown."""
        if self._corrections < _FIRST:
            return self._news * _GROWN >= self._corrections > 0
        if self._news * _LEAST_NEWS < len(self._steps):
            return False
        mass, _, _, turning = self._linearised_at[:4].tolist()
        scale = np.array([mass, np.sqrt(mass * turning), np.sqrt(mass * turning), turning])
        return bool((np.abs(self._parameters[:4] - self._linearised_at[:4]) > _MOVED * scale).any())

    def _changed_since(self) -> int:
        newest = islice(reversed(self._steps), max(WINDOWS) + USUAL_OF)
        return self._jump_test.changed_since([step.surprise for step in newest])

    def _expect_another_cart(self, since: int) -> None:
        """Widen the belief before a change of the load ``since`` steps ago, and repeat the steps from there."""
        steps = list(self._steps)[-since:]
        self._steps.clear()
        self._change = self._change_after(steps[0].before)
        self.belief = self._change.start()
        self._linearised_at = self._parameters
        self._corrections = self._unchanged = 0
        self.jumps += 1
        for step in steps:
            self._steps.append(step)
            self._do(step)

    def _change_after(self, before: Belief) -> _Change:
        """A change by an unknown load."""
        free = axes(float(before.mean[2]))[:, MOVING]
        covariance = before.covariance.copy()
        covariance[RATES, RATES] += self._prior.jolt**2 * free @ free.T
        load = UnknownLoad(before.mean[PHI], covariance[PHI, PHI], self._prior)
        return _Change(Belief(before.mean, covariance), load)

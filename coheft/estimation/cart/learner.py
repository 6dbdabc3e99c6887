"""Finds out what a cart is while it is pushed: an extended Kalman filter that goes back when it has learned better.

The dynamics are linear in the parameters' inverse, not in the parameters. A filter that begins with a cart of half the
mass follows wrong slopes until it knows better, and is then surer than it may be, also of what nothing has shown yet.
So the last seconds are kept, and when the parameters have moved, done again, linearised about where they are now:
within them, all slopes belong to one and the same cart.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from itertools import islice
from math import cos, hypot, inf, sin, sqrt

import numpy as np

from coheft.estimation.cart.contact import MOVING
from coheft.estimation.cart.filter import (
    INNOVATION_SIZE,
    MOTION_SIZE,
    PARAMETERS,
    Belief,
    Push,
    Sighting,
    move,
    predict,
    smooth,
    update,
)
from coheft.estimation.cart.jump import USUAL_OF, WINDOWS, JumpTest
from coheft.estimation.cart.linearisation import FRICTION, PHI, POSE, RATES, STATE_SIZE
from coheft.estimation.cart.load import UnknownLoad
from coheft.estimation.cart.model import CartBody, axes
from coheft.estimation.cart.noise import WhiteNoise, doubts, misfit
from coheft.estimation.cart.prior import CartPrior, nearest_possible
from coheft.estimation.cart.steps import Change, Step, surprise
from coheft.estimation.geometry.spatial import Array

_MASS = 6
"""This component of the filter's state is the mass."""
_KEPT = 600
"""So many of the newest steps are kept, to be done again."""
_MOVED = 0.01
"""Parameters have moved when they differ from those of the slopes by more than about this share."""
_SURELY = 2.0
"""The cart is surely fast if it would still be so when slower by so many standard deviations."""
_VAGUE = 1e3
"""The filter begins with this multiple of the first measurement's covariance of the pose."""
_NOTHING = 1e6
"""A measurement that was none has this variance, [m², rad²] of poses and [m²/s², rad²/s²] of rates."""
_LEAST_NEWS = 4
"""With a known cart, steps are done again only when at least one in so many is new."""
_FIRST = 200
"""A cart is unknown until there have been so many steps with something to learn from."""
_JUDGED_EVERY = 25
"""After so many steps innovations are judged."""
_TOO_NEW = 16
"""But not those of the newest steps."""
_LEAST_JUDGED = 64
"""And not fewer."""
_MOST_MISFIT, _LITTLE_MISFIT = 10.0, 3.0
"""Noise of the motion that had to be so many times as large is rather a wrench; with that it need not be."""
_UNKNOWN_WRENCHES = (0.3, 1.0, 3.0, 10.0)
"""Standard deviations that are tried [N]."""
_LEVER = 0.2
"""Its torque has this multiple [m]."""
_GROWN = 3
"""With an unknown cart, whose slopes are soon far off, steps are done again when one in so many is new."""


class CartLearner:
    """What one knows of a cart, from its first measurement on.

    An iterated extended Kalman smoother over the last steps: after the iterated linear filter-smoother of Jazwinski,
    "Stochastic Processes and Filtering Theory" (1970), over many steps instead of one. So each time that steps are done
    again is one step of Gauss and Newton (Bell, "The iterated Kalman smoother as a Gauss-Newton method", 1994).

    Args:
        guess: The cart, as far as known.
        first: The first measurement.
        prior: How wrong the guess may be.

    Attributes:
        belief: Of state and parameters, after the last push.
        jumps: How many sudden changes have been noticed.
        is_judged: Whether enough has been measured to see whether it fits the model.
    """

    def __init__(self, guess: CartBody, first: Sighting, prior: CartPrior) -> None:
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
        self._steps: deque[Step] = deque(maxlen=_KEPT)
        self._slopes_of = self._parameters
        self._news = 0
        self._lessons = 0
        self._change: Change | None = None
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
        result: Array = inverse @ self.belief.covariance[PARAMETERS, PARAMETERS] @ inverse.T
        return result

    def doubts(self) -> list[str]:
        """What is measured worse than is said, in words; empty if nothing is. Covariances count with that already."""
        return doubts(self._white_noise.levels * self._misfit, self._unknown_wrench)

    def ahead(self, wrenches_b: list[Array], duration: float) -> Array:
        """``(q, qd)`` after further steps with these wrenches, each of ``duration`` [s]."""
        state = self.belief.mean.copy()
        state[PARAMETERS] = self._parameters
        for wrench_b in wrenches_b:
            state = move(state, wrench_b, duration)
        return state[:MOTION_SIZE].copy()

    def step(self, sighting: Sighting, push: Push) -> None:
        """Take in a measurement, and what the hands did from then on."""
        self._take_in(sighting, push, is_louder=self._white_noise.see(sighting))

    def coast(self, push: Push) -> None:
        """A push without a measurement before it."""
        nothing = Sighting(self.belief.mean[:MOTION_SIZE], _NOTHING * np.eye(MOTION_SIZE))
        self._take_in(nothing, push, is_louder=False)

    def _take_in(self, sighting: Sighting, push: Push, *, is_louder: bool) -> None:
        """One step; whether noise has been found to be larger than before."""
        is_fast = self._is_fast()
        casters_turn = self._casters_turn(push.duration, is_fast=is_fast)
        if casters_turn:
            push = replace(push, covariance=push.covariance + self._drag)
        step = Step(sighting, push, is_fast and not casters_turn, self._white_noise.levels, self.belief)
        if len(self._steps) == _KEPT:
            self._change = None  # the steps that are kept begin later
        self._steps.append(step)
        self._lessons += step.corrects_cart
        self._news += step.corrects_cart
        self._do(step)
        self._judged += 1
        if self._judged >= _JUDGED_EVERY:
            self._judge()
        since = self._changed_since()
        is_louder = is_louder or (since > 0 and self._white_noise.is_new())
        if is_louder:
            for recent in islice(reversed(self._steps), self._white_noise.seen):
                recent.levels = np.maximum(recent.levels, self._white_noise.levels)
        if since or is_louder or self._is_due():
            self._do_again()
            since = self._changed_since()
        if since:
            self._expect_another_cart(since)

    @property
    def _parameters(self) -> Array:
        """``(phi, sigma)``, shape (6,), such as a cart can have."""
        phi = nearest_possible(self.belief.mean[PHI], *self._least)
        return np.concatenate([phi, np.maximum(self.belief.mean[FRICTION], 0.0)])

    def _point(self, state: Array) -> Array:
        """Where to linearise: at this motion, and at the parameters that all slopes belong to."""
        return np.concatenate([state[:MOTION_SIZE], self._slopes_of])

    def _is_fast(self) -> bool:
        """Whether the cart surely rolls faster than what the model does not hold for."""
        velocity = self.belief.mean[3:5]
        speed = hypot(*velocity.tolist())
        variance = float(velocity @ self.belief.covariance[3:5, 3:5] @ velocity)  # of the speed, times its square
        return speed * speed >= self._prior.slow * speed + _SURELY * sqrt(max(variance, 0.0))

    def _casters_turn(self, duration: float, *, is_fast: bool) -> bool:
        """Whether the cart goes another way than before, and not far yet; on by one step [s]."""
        theta, x_rate, y_rate = self.belief.mean[2:5].tolist()
        speed = cos(theta) * x_rate + sin(theta) * y_rate
        if is_fast and speed * self._direction < 0.0:
            self._rolled = 0.0
        if is_fast:
            self._direction = speed
        self._rolled += abs(speed) * duration
        return self._rolled < self._prior.turning

    def _do(self, step: Step, smoothed: Array | None = None) -> None:
        """One step, with slopes at the motion that is believed in, or at one that is known better by now."""
        step.before = self.belief
        at = self._point(self.belief.mean if smoothed is None else smoothed)
        levels = step.levels * self._misfit
        sighting = replace(step.sighting, covariance=step.sighting.covariance * np.outer(levels, levels))
        step.update = update(self.belief, sighting, self._prior.slip, at, corrects_cart=step.corrects_cart)
        if smoothed is None:
            at = self._point(step.update.belief.mean)
        force, torque = self._unknown_wrench**2, (_LEVER * self._unknown_wrench) ** 2
        push = replace(step.push, covariance=step.push.covariance + np.diag([force, force, torque]))
        step.prediction = predict(step.update.belief, push, self._drift, at)
        self.belief = step.prediction.belief

    def _do_again(self) -> None:
        """All steps that are kept, with slopes at the newest parameters, and at the motion as it looks from here."""
        self._slopes_of = self._parameters
        self._news = 0
        done = [(step.update, step.prediction) for step in self._steps]
        smoothed = smooth([(u, p) for u, p in done if u is not None and p is not None])
        if self._change is None:
            self.belief = self._steps[0].before
        else:
            self._change.load.learn(self.belief.mean[PHI], self.belief.covariance[PHI, PHI])
            self.belief = self._change.start()
        for step, state in zip(self._steps, smoothed, strict=True):
            self._do(step, state)

    def _judge(self) -> None:
        """Let noise be larger if innovations say so: that of the motion, or if it were far too large, of the wrench."""
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
        """From all innovations but the newest, which may be of a cart that has just changed; None if they are few."""
        old = islice(self._steps, max(0, len(self._steps) - _TOO_NEW))
        innovations = [step.update.innovation for step in old if step.corrects_cart and step.update is not None]
        return misfit(np.array(innovations), self._misfit) if len(innovations) >= _LEAST_JUDGED else None

    def _is_due(self) -> bool:
        """Whether to do all again: enough is new, and the cart looks different, or little was known the last time."""
        if self._lessons < _FIRST:
            return self._news * _GROWN >= self._lessons > 0
        return self._news * _LEAST_NEWS >= len(self._steps) and self._have_moved()

    def _have_moved(self) -> bool:
        """Whether the slopes in use belong to another cart than the newest."""
        mass, _, _, turning = self._slopes_of[:4].tolist()
        scale = np.array([mass, np.sqrt(mass * turning), np.sqrt(mass * turning), turning])
        return bool((np.abs(self._parameters[:4] - self._slopes_of[:4]) > _MOVED * scale).any())

    def _changed_since(self) -> int:
        newest = islice(reversed(self._steps), max(WINDOWS) + USUAL_OF)
        return self._jump_test.changed_since([surprise(step) for step in newest])

    def _expect_another_cart(self, since: int) -> None:
        """A load came or went so many steps ago: go back, be unsure of parameters and velocity, and come again."""
        steps = list(self._steps)[-since:]
        self._steps.clear()
        before = steps[0].before
        self._change = self._change_after(before)
        self.belief = before if self._change is None else self._change.start()
        self._slopes_of = self._parameters
        self._lessons = 0
        self.jumps += 1
        for step in steps:
            self._steps.append(step)
            self._do(step)

    def _change_after(self, before: Belief) -> Change | None:
        """Of any load; None if that is believed already: the alarm may be one of several for the same change."""
        missing = 1.0 - float(before.covariance[_MASS, _MASS]) / self._prior.load**2
        if missing <= 0.0:
            return None
        free = axes(float(before.mean[2]))[:, MOVING]
        covariance = before.covariance.copy()
        covariance[RATES, RATES] += missing * self._prior.jolt**2 * free @ free.T
        load = UnknownLoad(before.mean[PHI], covariance[PHI, PHI], self._prior, missing)
        return Change(Belief(before.mean, covariance), load)

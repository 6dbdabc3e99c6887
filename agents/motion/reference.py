"""Reference motions that make the load observable."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from coheft.agents.motion.via_points import ViaPointMotion
from coheft.agents.plugins.loading import make_own
from coheft.errors import PluginError
from coheft.estimation.geometry.smooth_step import cubic_step
from coheft.estimation.geometry.spatial import Array
from coheft.wire.config import AgentConfig
from coheft.wire.scenario.plugins import told
from coheft.wire.scenario.schema import Motion
from coheft.wire.scenario.waves import Waves

_AT_ONCE = 320
"""Samples for which references are worked out at once: that takes hardly longer than for a few."""


class ReferenceMotion(Protocol):
    """One robot's reference motion. Deterministic: equal inputs give equal outputs, bit for bit."""

    def reference(self, block: int) -> Array:
        """Displacement from the home pose during a block, and its rate.

        Args:
            block: Its number; blocks may be asked for in any order.

        Returns:
            Shape (B, 12): rotation vector [rad], position [m], in the axes of the home frame, then the rates of both.
        """
        ...


def make_motion(config: AgentConfig) -> ReferenceMotion:
    """Make the reference motion that an agent is configured to use.

    Raises:
        PluginError: It is one of the user's own, and cannot be used.
    """
    motion = config.motion
    if motion.own is not None:
        return OwnMotion(motion.own, config)
    if motion.via_points is not None:
        return ViaPointMotion(motion, motion.via_points, config.seed, config.rate, config.block)
    return Excitation(motion, config.waves, config.rate, config.block)


class OwnMotion:
    """A motion of the user's own: what it returns has the right shape, or the agent ends and says what is wrong.

    That numbers are finite, and such that the arm can follow, is for whoever moves the arm to see.

    Args:
        name: Of its entry point.
        config: The robot's.

    Raises:
        PluginError: It cannot be used.
    """

    def __init__(self, name: str, config: AgentConfig) -> None:
        self._what = f"the motion {name!r} of {config.name}"
        self._shape = (config.block, 12)
        self._own: ReferenceMotion = make_own("motion", name, ReferenceMotion, config)
        self.reference(0)

    def reference(self, block: int) -> Array:
        """See ``ReferenceMotion.reference``.

        Raises:
            PluginError: It fails, or returns something else.
        """
        try:
            reference = np.array(self._own.reference(block), dtype=np.float64)
        except Exception as error:  # whatever somebody else's code raises
            where = told(error, type(self._own).__module__)
            raise PluginError(f"{self._what} knows no reference for block {block}: {where}") from error
        if reference.shape != self._shape:
            raise PluginError(
                f"{self._what}: its reference for block {block} has the shape {reference.shape}, expected {self._shape}"
            )
        return reference


class Excitation:
    """Two sinusoids of incommensurate frequencies per axis, drawn for this robot alone, with a smooth start.

    All six degrees of freedom move, at frequencies at which the payload's inertia matters: identification needs
    acceleration, and slow motions are all gravity.

    Args:
        motion: Amplitudes, ramp.
        waves: The sinusoids.
        rate: Samples per second.
        block: Samples per block.
    """

    def __init__(self, motion: Motion, waves: Waves, rate: int, block: int) -> None:
        self._amplitudes = 0.5 * np.repeat([motion.rotation, motion.translation], 3) * motion.axes
        self._omegas = 2.0 * np.pi * np.array(waves.frequencies)
        # Angles during a block, as turns from its first sample on: sines of sums take less time than sines.
        steps = self._omegas * (np.arange(block) / rate)[:, None, None]
        turns = np.array([np.sin(steps), np.cos(steps)])
        # By axis, shape (6, B, 4): sine and cosine of both waves.
        self._turns = np.ascontiguousarray(turns.transpose(3, 1, 0, 2).reshape(6, block, 4))
        self._phases = np.array(waves.phases)
        self._ramp = motion.ramp
        self._rate = rate
        self._block = block
        self._at_once = max(1, _AT_ONCE // block)
        self._first: int | None = None
        self._references = np.empty((0, block, 12))

    def reference(self, block: int) -> Array:
        """See ``ReferenceMotion.reference``; read only."""
        place = block % self._at_once
        if block - place != self._first:
            self._first, self._references = block - place, self._from(block - place)
        reference: Array = self._references[place]
        return reference

    def _from(self, first: int) -> Array:
        """References of several blocks, shape (n, B, 12)."""
        start = (first + np.arange(self._at_once)) * self._block / self._rate
        phases = self._omegas * start[:, None, None] + self._phases
        cosine, sine = self._amplitudes * np.cos(phases), self._amplitudes * np.sin(phases)
        # Of the position and of its rate, of either turn, for each block, of both waves, about each axis.
        gains = np.array([[cosine, sine], [-self._omegas * sine, self._omegas * cosine]])
        by_axis = self._turns @ gains.transpose(4, 1, 3, 2, 0).reshape(6, 4, -1)
        waves = by_axis.reshape(6, self._block, self._at_once, 2).transpose(2, 1, 3, 0)
        if start[0] < self._ramp:
            ramp, ramp_rate = self._ramp_at(start[:, None] + np.arange(self._block) / self._rate)
            waves = np.stack([ramp * waves[:, :, 0], ramp * waves[:, :, 1] + ramp_rate * waves[:, :, 0]], axis=2)
        references: Array = waves.reshape(self._at_once, self._block, 12)
        references.flags.writeable = False
        return references

    def _ramp_at(self, time: Array) -> tuple[Array, Array]:
        """Smooth step from 0 to 1 over the ramp, and its rate, at times (n, B), each (n, B, 1)."""
        share, rate = cubic_step(np.clip(time / self._ramp, 0.0, 1.0)[..., None])
        return share, rate / self._ramp

"""Reference motions that make the load observable."""

from typing import Protocol

import numpy as np

from coheft.agents.motion.via_points import ViaPointMotion
from coheft.agents.plugins.loading import make_own
from coheft.errors import PluginError
from coheft.estimation.geometry.smooth_step import cubic_step
from coheft.estimation.geometry.spatial import Array
from coheft.wire.config import AgentConfig
from coheft.wire.scenario.motion import Motion, Waves
from coheft.wire.scenario.plugins import told

_BATCH = 320
"""Number of samples for which references are computed at once, which takes hardly longer than for a few."""


class ReferenceMotion(Protocol):
    """One robot's reference motion. Deterministic: equal inputs give equal outputs, bit for bit."""

    def reference(self, block: int) -> Array:
        """Return the displacement from the home pose during a block, and its rate.

        Args:
            block: The block's number; blocks may be requested in any order.

        Returns:
            Shape (B, 12): rotation vector [rad], position [m], in the axes of the home frame, then the rates of both.
        """
        ...


def make_motion(config: AgentConfig) -> ReferenceMotion:
    """Make the motion that a configuration names; raise ``PluginError`` if a user's own cannot be used."""
    motion = config.motion
    if motion.own is not None:
        return OwnMotion(motion.own, config)
    if motion.via_points is not None:
        return ViaPointMotion(motion, motion.via_points, config.seed, config.rate, config.block)
    return Excitation(motion, config.waves, config.rate, config.block)


class OwnMotion:
    """A user's motion. Checks the shape of what it returns, and raises an error that names the problem.

    Whether numbers are finite, and whether the arm can follow them, is checked where the arm is moved.

    Raises:
        PluginError: The motion cannot be used.
    """

    def __init__(self, name: str, config: AgentConfig) -> None:
        self._what = f"the motion {name!r} of {config.name}"
        self._shape = (config.block, 12)
        self._own: ReferenceMotion = make_own("motion", name, ReferenceMotion, config)
        self.reference(0)

    def reference(self, block: int) -> Array:
        """See ``ReferenceMotion.reference``.

        Raises:
            PluginError: The motion raises an exception, or returns another shape.
        """
        try:
            reference = np.array(self._own.reference(block), dtype=np.float64)
        except Exception as error:  # a user's code may raise anything
            where = told(error, type(self._own).__module__)
            raise PluginError(f"{self._what} returned no reference for block {block}: {where}") from error
        if reference.shape != self._shape:
            raise PluginError(
                f"{self._what}: its reference for block {block} has the shape {reference.shape}, expected {self._shape}"
            )
        return reference


class Excitation:
    """Two sinusoids of incommensurate frequencies per axis, drawn for this robot alone, with a smooth start.

    All six degrees of freedom move, at frequencies at which inertial forces matter: identification needs acceleration,
    and in slow motions gravity dominates.
    """

    def __init__(self, motion: Motion, waves: Waves, rate: int, block: int) -> None:
        self._amplitudes = 0.5 * np.repeat([motion.rotation, motion.translation], 3) * motion.axes
        self._omegas = 2.0 * np.pi * np.array(waves.frequencies)
        self._phases = np.array(waves.phases)
        self._ramp = motion.ramp
        self._rate = rate
        self._block = block
        self._batch = max(1, _BATCH // block)
        self._first: int | None = None
        self._references = np.empty((0, block, 12))

    def reference(self, block: int) -> Array:
        """See ``ReferenceMotion.reference``. The array is read-only."""
        place = block % self._batch
        if block - place != self._first:
            self._first, self._references = block - place, self._from(block - place)
        reference: Array = self._references[place]
        return reference

    def _from(self, first: int) -> Array:
        """Return references of several blocks, shape (n, B, 12)."""
        times = (first * self._block + np.arange(self._batch * self._block)) / self._rate
        angles = self._omegas * times[:, None, None] + self._phases  # by time, wave and axis
        shift = (self._amplitudes * np.sin(angles)).sum(axis=1)
        rate = (self._amplitudes * self._omegas * np.cos(angles)).sum(axis=1)
        if times[0] < self._ramp:
            share, share_rate = cubic_step(np.clip(times / self._ramp, 0.0, 1.0)[:, None])
            shift, rate = share * shift, share * rate + share_rate / self._ramp * shift
        references: Array = np.hstack([shift, rate]).reshape(self._batch, self._block, 12)
        references.flags.writeable = False
        return references

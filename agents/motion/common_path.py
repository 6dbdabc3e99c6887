"""The path along which all robots carry the load together, as one agent computes it."""

import numpy as np

from coheft.estimation.geometry.smooth_step import least_jerk_step
from coheft.estimation.geometry.spatial import Array
from coheft.wire.scenario.motion import Carry


class CommonPath:
    """A sinusoid per coordinate, with a smooth start from ``start`` [s] on.

    At a given time the path is the same for all robots whose start is over, whenever each started.
    """

    def __init__(self, carry: Carry, start: float) -> None:
        self._amplitudes = np.concatenate([np.radians(carry.rotation_deg), carry.translation])
        self._omegas = 2.0 * np.pi / np.concatenate([carry.rotation_period, carry.translation_period])
        self._begin = carry.start
        self._start = start
        self._ramp = carry.ramp

    @property
    def full_from(self) -> float:
        """Time at which the smooth start is over [s]."""
        return self._start + self._ramp

    def displacement(self, time: Array) -> tuple[Array, Array]:
        """Return the displacement of the first robot's grasp frame in its home frame, and its rate.

        Args:
            time: Times [s], shape (n,).

        Returns:
            Two arrays, shape (n, 6): rotation vector [rad] and position [m], and their rates.
        """
        phases = self._omegas * (time[:, None] - self._begin)
        wave = self._amplitudes * np.sin(phases)
        wave_rate = self._amplitudes * self._omegas * np.cos(phases)
        share, share_rate = self.share(time)
        return share * wave, share * wave_rate + share_rate * wave

    def share(self, time: Array) -> tuple[Array, Array]:
        """Return a smooth step from 0 to 1 during the start, and its rate, each (n, 1)."""
        s = np.clip((time - self._start) / self._ramp, 0.0, 1.0)[:, None]
        share, rate = least_jerk_step(s)  # the acceleration is continuous
        return share, rate / self._ramp

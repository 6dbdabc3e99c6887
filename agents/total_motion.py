"""The body's motion, out of the team's sums."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from agents.outliers import outliers
from agents.sums import Entered
from coheft.estimation.motion_fusion import CHANNELS, MotionFusion, derivative, slope_kernel
from coheft.estimation.spatial import Array, Pose
from coheft.wire.config import AgentConfig

_NOISELESS = 1e-100
"""Standard deviation of sums to which no robot adds anything."""


class TotalMotion:
    """The newest sums of a team, and how motion follows from them.

    Where the accelerometers do not see all of the angular acceleration, the gyros' slope fills in, which takes the
    neighbouring blocks.

    Args:
        config: The agent's settings.
        poses: Of all robots, in the body frame.

    Attributes:
        fusion: Of the sensors of all robots, at the poses in use.
    """

    def __init__(self, config: AgentConfig, poses: Sequence[Pose]) -> None:
        self._config = config
        self._kernel = slope_kernel(config.rate, config.block)
        self._half_span = len(self._kernel) // 2
        self._totals: dict[int, tuple[Entered, Array]] = {}
        self.set_poses(poses)

    def set_poses(self, poses: Sequence[Pose]) -> None:
        """From now on sums are seen with these poses."""
        self.fusion: MotionFusion = MotionFusion.of_robots(self._config.noise, poses, self._kernel)
        # What all robots feel together adds up, noise does not.
        self._deviations = np.sqrt(len(poses)) * np.maximum(self.fusion.deviations.ravel(), _NOISELESS)

    @property
    def slope(self) -> Array:
        """What the gyros' slope says about ``(a, alpha)``, shape (6, 6)."""
        return self.fusion.slope_information

    @property
    def needs_slope(self) -> bool:
        """Whether a block's motion takes the blocks beside it as well."""
        return self.fusion.derivative_gain is not None

    def add(self, entered: Entered, sums: Array) -> int | None:
        """Take in the sums (B, 3, 6) of a block, unless they are not plausible.

        Returns:
            The newest block that may be ready to be looked at now; None if these cannot be true.
        """
        block = entered.block
        before = self._totals.get(block - 1)
        if not self.are_plausible(sums, None if before is None else before[1]):
            return None
        self._totals[block] = entered, sums
        self._totals = {number: total for number, total in self._totals.items() if number > block - 3}
        return block - 1 if self.needs_slope else block

    def are_plausible(self, sums: Array, before: Array | None = None) -> bool:
        """Whether the sums (B, 3, 6) of a block, and of the one ``before`` it, are without outliers.

        Every robot has looked at its own samples: then these are hardly of a sensor, but of somebody's memory.
        """
        rows = (sums if before is None else np.concatenate([before[-1:], sums])).reshape(-1, CHANNELS)
        with np.errstate(over="ignore"):  # a flipped bit can make any number of any other
            steps = (rows[1:] - rows[:-1]) / self._deviations
        return outliers(steps) is None

    def look_at(self, block: int, use_poses: Callable[[int], None]) -> tuple[Entered, Array, Array] | None:
        """What a block shows. When its poses make the slope needless, the one after it is not looked at.

        Args:
            block: Its number, from ``add``.
            use_poses: Called with the version of the poses that it was carried with, to bring these into use.

        Returns:
            The own samples as they entered, the team's sums (B, 3, 6), and the motion of the body (B, 12); None if the
            block, or one that it takes beside it, is missing.
        """
        total = self._totals.get(block)
        if total is None:
            return None
        entered, sums = total
        use_poses(entered.version)
        motion = self._motion(block, sums)
        return None if motion is None else (entered, sums, motion)

    def _motion(self, block: int, sums: Array) -> Array | None:
        if not self.needs_slope:
            return self.fusion.motion(sums)
        slope = self._slope(block)
        return None if slope is None else self.fusion.motion(sums, slope)

    def _slope(self, block: int) -> Array | None:
        """Derivative of the fused ``w`` during a block (B, 3)."""
        around = [self._totals.get(number) for number in (block - 1, block, block + 1)]
        w = [self.fusion.angular_velocity(total[1]) for total in around if total is not None]
        size, half = self._config.block, self._half_span
        return derivative(np.concatenate(w)[size - half : 2 * size + half], self._kernel) if len(w) == 3 else None

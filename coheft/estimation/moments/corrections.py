"""How rates of late sensors and the flexing of grasps correct rows, and the variances of the noise after that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments import rows
from coheft.estimation.moments.rows import FLEXING_SIZE, RowNoise
from coheft.estimation.moments.sensor_errors import RATES, SensorErrors


@dataclass(frozen=True, eq=False)
class Corrections:
    """The corrections of all robots' rows at one state, whose ``calibration`` takes extended rows to calibrated ones.

    Methods take ``rows.KINEMATICS`` or ``rows.WRENCH``, k numbers of a row.
    """

    noise: RowNoise
    errors: SensorErrors
    calibration: Array | None
    count: int

    def variance(self, part: slice) -> Array:
        """Variance of a part of all rows as corrected, shape (N, k); infinite where there is no sensor."""
        deviations = self._deviations(part)
        variance: Array = np.broadcast_to(deviations**2.0, (self.count, deviations.shape[1]))
        if self.errors.has_rates:
            variance = variance + (np.square(self.by_rates(part)) @ self.variance_of_rates(part)[..., None])[..., 0]
        if self.errors.is_flexing and self.calibration is not None:
            by_flexing = np.square(self.by_flexing(part)) @ self.variance_of_flexing()[..., None]
            variance = variance + by_flexing[..., 0]
        return variance

    def variance_of_rates(self, part: slice) -> Array:
        """Variance of the rates of a part of all rows, shape (N, k)."""
        deviations = self._deviations(part)
        variance = np.where(np.isfinite(deviations), deviations, 0.0) ** 2.0 * self.noise.rates[:, part] ** 2.0
        return np.broadcast_to(variance, (self.count, variance.shape[1]))

    def variance_of_flexing(self) -> Array:
        """Effective noise variance of each robot's flexing, shape (N, 6)."""
        force = np.where(np.isfinite(self.noise.wrench), self.noise.wrench, 0.0)[:, [0, 1, 2, 0, 1, 2]]
        return np.broadcast_to(force**2.0 * self.noise.flexing**2.0, (self.count, FLEXING_SIZE))

    def by_rates(self, part: slice) -> Array:
        """Correction of a part of each row by its rates, shape (N, k, k); there must be rates."""
        assert self.calibration is not None
        return self.calibration[:, part, RATES + part.start : RATES + part.stop]

    def by_flexing(self, part: slice) -> Array:
        """Correction of a part of each row by the robot's flexing, shape (N, k, 6)."""
        assert self.calibration is not None
        return self.calibration[:, part, self.errors.flexing]

    def _deviations(self, part: slice) -> Array:
        return self.noise.wrench if part == rows.WRENCH else self.noise.kinematics

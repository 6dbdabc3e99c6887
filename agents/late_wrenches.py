"""Whether the wrenches of late are those of the load that is remembered."""

from __future__ import annotations

import numpy as np

from agents.load_moments import HARDLY_MORE
from coheft.estimation.inertia import FEATURES, WRENCH_FEATURES, InertiaInformation, InertiaModel, unpacked_gram
from coheft.estimation.spatial import Array

_RECENT = 0.25
"""Time over which recent residuals are averaged [s]."""
_CONTRADICTION = 80.0
"""Limit of the chi-square of the mean recent residual, six degrees of freedom: 4e-15 by chance."""
_GIVE_UP = 0.5
"""After so long a contradiction what is remembered is of another load [s]."""
_SINGULAR = 1e-12
"""What is added to an information, relative to itself, so that it has an inverse."""
_IDENTITY = np.eye(6)


class LateWrenches:
    """The mean of the newest samples' features, and the load that they should belong to.

    Args:
        blocks_per_second: Blocks per second.
    """

    def __init__(self, blocks_per_second: float) -> None:
        self._kept = float(np.exp(-1.0 / (_RECENT * blocks_per_second)))
        self._give_up_after = max(1, round(_GIVE_UP * blocks_per_second))
        self.begin()

    def begin(self) -> None:
        """It is another load from now on."""
        self._sums = np.zeros(FEATURES)
        self._residual_of_features: Array | None = None
        self._solved_of = 0.0
        self._contradicted = 0

    @property
    def contradict(self) -> bool:
        """Whether they do not fit the load."""
        return self._contradicted > 0

    @property
    def have_long_contradicted(self) -> bool:
        """Whether they have not fitted it for so long that it must be another one."""
        return self._contradicted > self._give_up_after

    def need_solution(self, count: float) -> bool:
        """Whether to find anew what the load is, of so many samples; always if that is not a number."""
        return self._residual_of_features is None or not self._solved_of <= count <= HARDLY_MORE * self._solved_of

    def add(self, sums: Array) -> None:
        """Take in a block: the sum of its samples' features, shape (19,)."""
        self._sums = self._kept * self._sums + sums

    def map(self, feature_map: Array) -> None:
        """All features are ``feature_map`` (19, 19) times what they were."""
        self._sums = feature_map @ self._sums

    def forget_solution(self) -> None:
        """Too little is remembered to say what the load is."""
        self._residual_of_features = None
        self._contradicted = 0

    def solve(self, model: InertiaModel, information: InertiaInformation) -> None:
        """Find what the load is, from all that is remembered."""
        ridge = _SINGULAR * np.diag(information.uncompensated.diagonal())
        unknowns = np.linalg.solve(information.matrix + ridge, information.vector)
        self._residual_of_features = -np.asarray(model.regressor_coefficients @ unknowns)
        self._residual_of_features[WRENCH_FEATURES] += _IDENTITY
        self._solved_of = float(information.count)

    def compare(self, model: InertiaModel, disturbance: Array) -> None:
        """Hold them against the load.

        Args:
            model: The weights.
            disturbance: Covariance (6, 6) of what poses add to wrenches.
        """
        if self._residual_of_features is None or self._sums[0] < 1.0:
            return
        count = self._sums[0]
        mean = self._sums / count
        residual = mean @ self._residual_of_features
        statistic = float(count * (residual @ model.weight @ residual))
        if statistic >= _CONTRADICTION:  # noise averages out, what poses add does not; it explains only more
            statistic = float(residual @ np.linalg.solve(model.residual_covariance / count + disturbance, residual))
        self._contradicted = 0 if statistic < _CONTRADICTION else self._contradicted + 1

    def surprise(self, model: InertiaModel, gram: Array) -> float:
        """Mean square of a block's residuals, in units of the noise, by what is known of the load; 0 if nothing is.

        Args:
            model: The weights.
            gram: Of the block's features, packed, shape (190,).
        """
        if self._residual_of_features is None:
            return 0.0
        squares = self._residual_of_features.T @ unpacked_gram(gram) @ self._residual_of_features
        return float(np.vdot(model.weight, squares) / (6.0 * gram[0]))

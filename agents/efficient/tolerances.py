"""Tolerances of sensors: as declared, until the errors that are found exceed them twice in a row."""

from __future__ import annotations

from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.widening import widened


class Tolerances:
    """The tolerances that one team's fits assume.

    Args:
        declared: Settings of fits with the declared tolerances.

    Attributes:
        settings: Settings of fits with the present ones.
    """

    def __init__(self, declared: FitSettings) -> None:
        self._declared = self.settings = declared
        self._exceeded_with = 0  # rows of the load when errors exceeded them; 0 if they do not

    @property
    def are_declared(self) -> bool:
        """Whether they are the declared ones."""
        return self.settings is self._declared

    def exceed(self, estimate: Estimate, rows: int) -> bool:
        """Process a fit after so many rows of the load whose errors exceed them; return whether that was so before.

        They grow then, as it is no passing cause.
        """
        is_again = self._exceeded_with > 0
        if is_again:
            self.settings = widened(estimate, self.settings, self._declared) or self.settings
        self._exceeded_with = rows
        return is_again

    def hold(self, rows: int) -> None:
        """Process a fit after so many rows of the load whose errors are within them."""
        if rows > 2 * self._exceeded_with:
            self._exceeded_with = 0

    def restore(self) -> None:
        """Assume the declared ones again."""
        self.settings, self._exceeded_with = self._declared, 0

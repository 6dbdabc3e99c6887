"""Whether a load that seems to have changed has: a sensor of its wrench that goes off looks much the same.

As long as the samples since are, but for a constant wrench, those of the load before, nobody can tell.
"""

from __future__ import annotations

import numpy as np

from coheft.estimation.chi_square import chi_square_threshold
from coheft.estimation.inertia import INERTIA_SIZE, InertiaModel
from coheft.estimation.load_comparison import KnownLoad, compare_despite_offset, compare_with_load
from coheft.estimation.spatial import Array

_CHANCE = 1e-4
"""Probability at a single test that the load seems to have changed though it is the same."""
_CHANCE_OFFSET = 1e-6
"""Probability at a single test that an offset is ruled out though there is one."""
_FEW = 50
"""Fewer samples do not show whether the load is the same as before,"""
_SETTLED = 0.5
"""nor do fewer than so many times those for which a disturbance keeps its direction."""
_HALF = 0.5
"""The sensor may have gone off, at the latest, so much of the samples later than the load seems to have changed;"""
_LEAST = 0.2
"""of such samples there have to be so many times those for which a disturbance keeps its direction."""
_MOST = 12
"""So many moments are tried at which it may have gone off."""


class FormerLoad:
    """What the load was before it seemed to change, until it is clear that it has; and what it was if it has not.

    Args:
        coherence: Number of samples for which a disturbance keeps its direction, or 0 if there is none.
        false_alarm: Probability at a single test that a load that has seemed to be the former one is doubted again.

    Attributes:
        suspected: What the load may still be; None if it is what the samples since say.
    """

    def __init__(self, coherence: float, false_alarm: float) -> None:
        self._coherence = coherence
        self._false_alarm = false_alarm
        self.suspected: KnownLoad | None = None
        # What was suspected until samples agreed with it.
        self._reference: KnownLoad | None = None

    def expect(self, load: KnownLoad) -> None:
        """From now on the load may be this one."""
        self.suspected, self._reference = load, None

    def reconsider(self) -> None:
        """What samples have agreed with may not be the load all the same."""
        if self._reference is not None:
            self.expect(self._reference)

    def known(self, model: InertiaModel, sums: Array) -> KnownLoad | None:
        """What the load is, or was as long as it is not clear whether it has changed.

        Samples may have agreed with what was known before only because they say less: that is kept until they say more.

        Args:
            model: The weights. Where offsets are among the unknowns, no sensor has to be suspected.
            sums: Of the samples, shape (190 + riders,).
        """
        if self.suspected is not None or model.unknowns > INERTIA_SIZE:
            return self.suspected
        load = KnownLoad.of(model, sums, self._coherence)
        return load if self._reference is None or load.outweighs(self._reference) else self._reference

    def begin(self, model: InertiaModel, sums: Array) -> None:
        """The load seems to have changed; these were the samples before. If that was in doubt, it still is."""
        self.suspected, self._reference = self.known(model, sums), None

    def compare(self, model: InertiaModel, since: Array) -> None:
        """Find out whether the load is another one, or what it was.

        Args:
            model: The weights.
            since: Sums since ever later borders, those of all samples first, shape (k, 190 + riders).
        """
        if self.suspected is None or len(since) == 0 or since[0, 0] < max(_FEW, _SETTLED * self._coherence):
            return
        (same,) = compare_with_load(model, self.suspected, since[:1], self._coherence)
        if same < chi_square_threshold(INERTIA_SIZE, _CHANCE):
            self.suspected, self._reference = None, self.suspected
        elif not self._may_be_offset(model, self.suspected, since):
            self.suspected = None

    def _may_be_offset(self, model: InertiaModel, former: KnownLoad, since: Array) -> bool:
        # The sensor may have gone off a little later than it seemed, and in the middle of a block.
        later = since[since[:, 0] >= max(_HALF * since[0, 0], _LEAST * self._coherence, 1.0)][:_MOST]
        if len(later) < 2:
            return True
        despite = compare_despite_offset(model, former, later, self._coherence)
        if np.all(despite >= chi_square_threshold(INERTIA_SIZE, _CHANCE_OFFSET)):
            return False
        # It may as well have been off when the former load was found.
        return not KnownLoad.despite_offset(model, since[0], self._coherence).outweighs(former)

    def look_again(self, model: InertiaModel, total: Array) -> None:
        """Doubt what a few samples have agreed with, if all of them do not.

        Args:
            model: The weights.
            total: Sums of all samples, shape (190 + riders,).
        """
        if self._reference is not None:
            (square,) = compare_with_load(model, self._reference, total[None], self._coherence)
            if square > chi_square_threshold(INERTIA_SIZE, self._false_alarm):
                self.reconsider()

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
"""Fewer samples do not show whether the load is the same as before."""
_SETTLED = 0.5
"""Nor do fewer samples than so many times those for which a disturbance keeps its direction."""
_HALF = 0.5
"""A sensor may have gone off later than the load seems to have changed: by this share of the samples since, at most."""
_LEAST = 0.2
"""Of the samples since it went off there have to be so many times those for which a disturbance keeps its direction."""
_MOST = 12
"""So many moments are tried at which a sensor may have gone off."""


class FormerLoad:
    """What the load was before it seemed to change, until it is clear that it has, or samples say much more.

    Args:
        coherence: Number of samples for which a disturbance keeps its direction, or 0 if there is none.
    """

    def __init__(self, coherence: float) -> None:
        self._coherence = coherence
        self._load: KnownLoad | None = None
        self._is_suspected = False

    @property
    def suspected(self) -> KnownLoad | None:
        """What the load may still be; None if it is what the samples since say."""
        return self._load if self._is_suspected else None

    def expect(self, load: KnownLoad) -> None:
        """From now on the load may be this one."""
        self._load, self._is_suspected = load, True

    def reconsider(self) -> None:
        """What samples have agreed with may not be the load all the same."""
        self._is_suspected = self._load is not None

    def known(self, model: InertiaModel, sums: Array) -> KnownLoad | None:
        """What the load is, or was as long as it is not clear whether it has changed.

        Samples may have agreed with what was known before only because they say less: that is kept until they say more.

        Args:
            model: The weights. Where offsets are among the unknowns, no sensor has to be suspected.
            sums: Of the samples, shape (190 + riders,).
        """
        if self._is_suspected or model.unknowns > INERTIA_SIZE:
            return self.suspected
        load = KnownLoad.of(model, sums, self._coherence)
        return load if self._load is None or load.outweighs(self._load) else self._load

    def begin(self, model: InertiaModel, sums: Array) -> None:
        """The load seems to have changed; these were the samples before. If that was in doubt, it still is."""
        self._load = self.known(model, sums)
        self.reconsider()

    def compare(self, model: InertiaModel, since: Array) -> None:
        """Find out whether the load is another one, or what it was; what few samples agree with, more may not.

        Args:
            model: The weights.
            since: Sums since ever later borders, those of all samples first, shape (k, 190 + riders).
        """
        if self._load is None or len(since) == 0 or since[0, 0] < max(_FEW, _SETTLED * self._coherence):
            return
        (square,) = compare_with_load(model, self._load, since[:1], self._coherence)
        is_same = square < chi_square_threshold(INERTIA_SIZE, _CHANCE)
        if is_same:
            is_over = KnownLoad.of(model, since[0], self._coherence).outweighs(self._load)
        else:
            is_over = not self._may_be_offset(model, self._load, since)
        self._load = None if is_over else self._load
        self._is_suspected = not is_over and not is_same

    def _may_be_offset(self, model: InertiaModel, former: KnownLoad, since: Array) -> bool:
        # The sensor may have gone off a little later than it seemed, and in the middle of a block.
        count, longest = since[0, 0], since[1:2, 0].max(initial=0.0)  # much may have come before there were borders
        later = since[since[:, 0] >= max(min(_HALF * count, longest), _LEAST * self._coherence, 1.0)][:_MOST]
        despite = compare_despite_offset(model, former, later, self._coherence)
        if len(later) > 1 and np.all(despite >= chi_square_threshold(INERTIA_SIZE, _CHANCE_OFFSET)):
            return False
        # It may as well have been off when the former load was found.
        return not KnownLoad.despite_offset(model, since[0], self._coherence).outweighs_everywhere(former)

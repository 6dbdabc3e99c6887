"""Which samples still count: a memory that notices when the load changes.

``LoadWindow`` keeps everything since the last change. For every border between stretches of blocks it compares "one
load all along" with "another load since this border", now and then also with "another load from this border to that
one": an adaptive window after Bifet and Gavalda (2007), with a generalised likelihood ratio test in place of a
difference of means.

It is a plain state machine: what it does depends on what it was told, on nothing else. It takes packed Gram matrices of
blocks (``inertia.packed_gram``). ``forgetting_window`` has the classical alternative.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from coheft.estimation.chi_square import chi_square_threshold
from coheft.estimation.former_load import FormerLoad
from coheft.estimation.inertia import GRAM_SIZE, InertiaInformation, InertiaModel
from coheft.estimation.load_comparison import KnownLoad, compare_loads
from coheft.estimation.spatial import Array
from coheft.estimation.stretches import Stretches

FALSE_ALARM = 1e-12
"""Probability that a single test reports a change where there is none. Tests of one border on successive blocks, and of
neighbouring borders, have much data in common."""
_CHANCE = 1e-4
"""Probability at a single test beyond which samples may be of two loads, though nobody is told of a change yet."""
_UNEVEN = 4.0
"""If two parts of the samples disagree, the covariance grows by the ratio of their sizes, but by at most this factor:
the smaller a part is, the less it says about how far the other is off."""
_LENGTHS = (1, 3)
"""Whether the load was another one for a while is tested for whiles of so many stretches in a row."""
_BETWEEN_EVERY = 16
"""How many tests of borders come to one test of whiles."""
_RESOLUTION = 8
"""Borders remain at most about one over this of their age apart."""
_STRIDE = 3
"""A review tests every third border, and others the next time; all after a detection."""
_YOUNG = 12
"""Up to so many borders, all are tested every time."""
_DRIFT = 2
"""So many small changes in a row are a drift."""
_SMALL = 4.0
"""A change is small if its statistic was below this many times the threshold."""
_OVERDUE = 3.0
"""A drift is over when this many times the usual interval went by without a change."""
_HARDLY = 1e-6
"""Information, relative to the rest, below which an estimate stays what it was."""


class LoadWindow:
    """All blocks since the load last changed.

    Args:
        false_alarm: Probability of one at a single test.
        riders: Numbers per block that are summed along with the Gram matrix, for the caller's use.
        every: Only one in so many reviews tests anything, unless the load is young.
        turn: Which one, and which borders first: robots that remember the same load and hear of each other's changes
            share the work by different turns.
        coherence: Number of samples for which a disturbance keeps its direction, or 0 if there is none. A disturbance
            spoils the wrenches beside noise, like poses that are off. The model knows that of all samples, and the
            first rider has to be the size of what else disturbs some of them.

    Raises:
        ValueError: There is a disturbance, and no rider.
    """

    def __init__(
        self,
        false_alarm: float = FALSE_ALARM,
        riders: int = 0,
        coherence: float = 0.0,
        every: int = 1,
        turn: int = 0,
    ) -> None:
        if coherence > 0.0 and riders < 1:
            raise ValueError(f"{riders=} but expected at least 1, the size of the disturbance, because {coherence=}")
        self._false_alarm = false_alarm
        self._coherence = coherence
        self._every = every
        self._reviews = turn
        self._changes: deque[tuple[int, float]] = deque(maxlen=_DRIFT)
        # Estimate before the last change, and how far it was from the one before.
        self._last: Array | None = None
        self._moved: Array = np.zeros(0)
        # Everything has to be tested: samples have come early, or are seen otherwise than before.
        self._is_due = False
        self._doubts: deque[float] = deque(maxlen=_STRIDE)  # of the last tests, which all borders had a part in
        self._doubt_between = 1.0
        self._former = FormerLoad(coherence)
        self._stretches = Stretches(GRAM_SIZE + riders, _RESOLUTION)

    @property
    def kept(self) -> float:
        """One: all."""
        return 1.0

    @property
    def doubt(self) -> float:
        """See ``Memory``."""
        return max(self._doubt_between, *self._doubts, 1.0)

    @property
    def former(self) -> KnownLoad | None:
        """See ``Memory``."""
        return self._former.suspected

    def known_load(self, model: InertiaModel) -> KnownLoad | None:
        """See ``Memory``."""
        return self._former.known(model, self._stretches.total) if len(self._stretches) else self.former

    def expect(self, load: KnownLoad) -> None:
        """See ``Memory``."""
        self._former.expect(load)

    def reconsider(self) -> None:
        """See ``Memory``."""
        self._former.reconsider()

    @property
    def first_block(self) -> int:
        """See ``Memory``."""
        return self._stretches.first

    @property
    def borders(self) -> npt.NDArray[np.int64]:
        """First blocks of the stretches that can be told apart, oldest first."""
        return self._stretches.firsts

    @property
    def total(self) -> Array:
        """See ``Memory``."""
        return self._stretches.total

    def revise(self, update: Callable[[Array], Array]) -> None:
        """See ``Memory``."""
        self._stretches.revise(update)
        self._is_due = True

    def push(self, block: int, gram: Array) -> None:
        """See ``Memory``."""
        self._stretches.push(block, gram)

    def push_early(self, block: int, gram: Array) -> None:
        """See ``Memory``."""
        self._is_due |= self._stretches.push_early(block, gram)

    def review(self, model: InertiaModel, is_coherent: bool = False) -> int | None:
        """Test whether the load changed at one of the borders; if so, forget all that is older than the likeliest one,
        until what is left is of one load.

        All samples are tested at once, and not in turns, while there are but few, or when more have come from before
        them, or they are seen otherwise. What it finds goes into ``doubt`` and ``former``, too.

        Args:
            model: The weights.
            is_coherent: Whether disturbances now keep their direction all along.

        Returns:
            See ``Memory``.
        """
        self._reviews += 1
        turn, rest = divmod(self._reviews, self._every)
        is_due = self._is_due and not is_coherent  # else soon
        is_unknown = is_due or len(self._stretches) <= _YOUNG
        if rest and not is_unknown:
            return None
        test_between = is_due or turn % _BETWEEN_EVERY == 0
        self._is_due &= is_coherent
        everything = slice(1, None)
        found, size = self._test_since(
            model, is_coherent, everything if is_unknown else slice(1 + turn % _STRIDE, None, _STRIDE)
        )
        if size > 1.0 and not is_unknown:
            found, size = self._test_since(model, is_coherent, everything)
        at_border = size > 1.0
        if not at_border and test_between and not is_coherent:
            found, size = self._test_between(model)
        change: int | None = None
        while size > 1.0:
            change = int(self._stretches.firsts[found])
            if at_border:
                self._former.begin(model, self._stretches.total - self._stretches.sums[found])
            self._begin(found, size, model)
            found, size = self._test_since(model, is_coherent, everything)
            at_border = True
        if not is_coherent:
            self._former.compare(model, self._stretches.sums)
        return change

    def _test_since(self, model: InertiaModel, is_coherent: bool, borders: slice) -> tuple[int, float]:
        """Test whether the load is another one since some border; keeps how doubtful that makes it.

        Returns:
            The likeliest border, and its statistic over what it hardly ever exceeds by chance.
        """
        newer = self._stretches.sums[borders]
        statistics, seen = self._compare(model, newer, is_coherent)
        self._doubts.append(self._doubt_by(statistics, seen, newer))
        if len(newer) == 0:
            return 0, 0.0
        found = int(np.argmax(statistics))
        size = float(statistics[found]) / _threshold(seen, self._false_alarm)
        return range(len(self._stretches))[borders][found], size

    def _test_between(self, model: InertiaModel) -> tuple[int, float]:
        """Test whether it was another one for a while: the more has come since, the less that shows at one border.

        Returns:
            As ``_test_since``: the border that ends the likeliest such while.
        """
        lengths = [length for length in _LENGTHS if length + 1 < len(self._stretches)]
        if not lengths:
            return 0, 0.0
        parts = np.concatenate([self._stretches.joined(length)[1:] for length in lengths])
        ends = np.concatenate([np.arange(length + 1, len(self._stretches)) for length in lengths])
        statistics, seen = self._compare(model, parts)
        self._doubt_between = self._doubt_by(statistics, seen, parts)
        found = int(np.argmax(statistics))
        return int(ends[found]), float(statistics[found]) / _threshold(seen, self._false_alarm)

    def _compare(self, model: InertiaModel, parts: Array, is_coherent: bool = False) -> tuple[Array, int]:
        """Statistics of parts (k, 190 + riders) against the rest, and their degrees of freedom."""
        coherence = np.inf if is_coherent and self._coherence else self._coherence
        return compare_loads(model, self._stretches.total, parts, coherence)

    def _doubt_by(self, statistics: Array, seen: int, parts: Array) -> float:
        """How doubtful statistics (k,) of parts make the load that exceed what they hardly do by chance."""
        is_doubtful = statistics > _threshold(seen, _CHANCE)
        counts = parts[is_doubtful, 0]
        rest = self._stretches.total[0] - counts
        # The smaller part may be the right one, from which the estimate is farther away.
        uneven = np.minimum(np.maximum(counts / rest, rest / counts), _UNEVEN)
        return float((statistics[is_doubtful] * uneven).max(initial=max(seen, 1))) / max(seen, 1)

    def statistics(self, model: InertiaModel) -> Array:
        """Twice the logarithm of the likelihood ratio at all ``borders`` but the first."""
        return self._compare(model, self._stretches.sums[1:])[0]

    def accept(self, block: int, model: InertiaModel) -> None:
        """See ``Memory``."""
        border = self._stretches.border(block)
        if 0 < border < len(self._stretches):
            statistics, seen = self._compare(model, self._stretches.sums[border : border + 1])
            self._former.begin(model, self._stretches.total - self._stretches.sums[border])
            self._begin(border, float(statistics[0]) / _threshold(seen, self._false_alarm), model)
        else:
            if border and border == len(self._stretches):
                self._former.begin(model, self._stretches.total)
            self.forget_before(block)

    def _begin(self, border: int, size: float, model: InertiaModel) -> None:
        """Forget what is older than a border, but not how far the load has moved since the change before."""
        now = self._stretches.count
        if self._changes and self._changes[-1][0] == now:  # one more in the same review
            size = max(size, self._changes.pop()[1])
        self._changes.append((now, size))
        older = model.information((self._stretches.total - self._stretches.sums[border])[:GRAM_SIZE])
        last = np.zeros(model.unknowns) if self._last is None else self._last
        ridge = _HARDLY * np.diag(older.uncompensated.diagonal())
        self._moved = np.asarray(np.linalg.solve(older.matrix + ridge, older.vector - older.matrix @ last))
        self._last = np.asarray(last + self._moved)
        self._trust()
        self.forget_before(int(self._stretches.firsts[border]))

    def _trust(self) -> None:
        """What made the load doubtful is forgotten."""
        self._doubts.clear()
        self._doubt_between = 1.0

    def forget_before(self, block: int) -> None:
        """See ``Memory``. What is left is as doubtful as it was: not all that disagreed may be forgotten."""
        self._stretches.forget_before(block)
        self._look_whether_empty()

    def forget_since(self, block: int) -> None:
        """See ``Memory``."""
        self._stretches.forget_since(block)
        self._look_whether_empty()

    def _look_whether_empty(self) -> None:
        """What comes next may be of another load."""
        if len(self._stretches) == 0:
            self._trust()
            self._former.reconsider()

    def forget_borders_before(self, block: int) -> None:
        """See ``Memory``."""
        self._stretches.forget_borders_before(block)

    @property
    def drifting(self) -> bool:
        """Whether the load seems to change all the time: small changes keep coming, and the next is not overdue."""
        if len(self._changes) < _DRIFT or max(size for _, size in self._changes) > _SMALL:
            return False
        interval = (self._changes[-1][0] - self._changes[0][0]) / (_DRIFT - 1)
        return self._stretches.count - self._changes[-1][0] < _OVERDUE * interval

    def information(self, model: InertiaModel) -> InertiaInformation:
        """Of all blocks since the last change.

        While the load drifts, it can have moved on unnoticed by as much as between the last changes.
        """
        information = model.information(self.total[:GRAM_SIZE])
        if not self.drifting:
            return information
        score = information.matrix @ self._moved
        return replace(information, score_covariance=information.score_covariance + np.outer(score, score))


def _threshold(freedom: int, probability: float) -> float:
    """What a statistic exceeds with this probability; what shows nothing exceeds nothing."""
    return chi_square_threshold(freedom, probability) if freedom else np.inf

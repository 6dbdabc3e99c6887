"""Which samples still count: a memory that notices when the load changes.

``LoadWindow`` keeps everything since the last change. It remembers ``O(log n)`` borders between blocks, dense among the
newest and ever sparser towards the oldest, and for each the sum of all that came after it. For every border it can so
compare "one load all along" with "another load since this border": an adaptive window after Bifet and Gavalda (2007),
with a generalised likelihood ratio test (Basseville and Nikiforov 1993) in place of a difference of means.

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
from coheft.estimation.inertia import GRAM_SIZE, InertiaInformation, InertiaModel
from coheft.estimation.load_samples import LoadChange
from coheft.estimation.spatial import Array

FALSE_ALARM = 1e-12
"""Probability that a single test reports a change where there is none. Tests of one border on successive blocks, and of
neighbouring borders, have much data in common."""
_CHANCE = 1e-4
"""Probability at a single test beyond which samples may be of two loads, though nobody is told of a change yet."""
_UNEVEN = 4.0
"""Where samples disagree, covariances count with their being divided as unevenly as this, and no more: the smaller a
part is, the less it says about how far the other is off."""
_YOUNG = 12
"""Up to so many borders, all are tested every time."""
_DRIFT = 2
"""So many small changes in a row are a drift,"""
_SMALL = 4.0
"""where small means that the statistic was below this many times the threshold."""
_OVERDUE = 3.0
"""A drift is over when this many times the usual interval went by without a change."""
_HARDLY = 1e-6
"""Information, relative to the rest, below which an estimate stays what it was."""
_TESTED = 0.2
"""Directions are tested in which at least this share of the information is motion, and not noise of motion."""


class LoadWindow:
    """All blocks since the load last changed.

    Args:
        resolution: Borders remain at most about ``1 / resolution`` of their age apart.
        stride: A review tests every ``stride``-th border, others the next time; of a young load all are tested, and
            after a detection.
        false_alarm: Probability of one at a single test.
        riders: Numbers per block that are summed along with the Gram matrix, for the caller's use.
        every: Only one in so many reviews tests anything, unless the load is young.
        turn: Which one, and which borders first: robots that remember the same load and hear of each other's changes
            share the work by different turns.
        coherence: Number of samples for which a disturbance keeps its direction, or 0 if there is none. A disturbance
            spoils the wrenches beside noise, like poses that are off. The model has its covariance up to its size, and
            the first rider has to be the sum of its sizes.
    """

    def __init__(
        self,
        resolution: int = 8,
        stride: int = 3,
        false_alarm: float = FALSE_ALARM,
        riders: int = 0,
        coherence: float = 0.0,
        every: int = 1,
        turn: int = 0,
    ) -> None:
        self._resolution = resolution
        self._stride = stride
        self._false_alarm = false_alarm
        self._coherence = coherence
        self._every = every
        self._reviews = turn
        self._changes: deque[tuple[int, float]] = deque(maxlen=_DRIFT)
        # Estimate before the last change, and how far it was from the one before.
        self._last: Array | None = None
        self._moved: Array = np.zeros(0)
        self._count = 0
        self._last_block = -1
        self._has_early = False
        self._doubts: deque[float] = deque(maxlen=stride)  # of the last tests, which all borders had a part in
        # Border k is the beginning of block _firsts[k], the _orders[k]-th that came; _sums[k] is all that came since.
        self._firsts = np.zeros(64, dtype=np.int64)
        self._orders = np.zeros(64, dtype=np.int64)
        self._sums = np.zeros((64, GRAM_SIZE + riders))
        self._borders = 0

    @property
    def doubt(self) -> float:
        """See ``Memory``."""
        return max(self._doubts, default=1.0)

    @property
    def first_block(self) -> int:
        """See ``Memory``."""
        return int(self._firsts[0]) if self._borders else -1

    @property
    def borders(self) -> npt.NDArray[np.int64]:
        """First blocks of the stretches that can be told apart, oldest first."""
        return self._firsts[: self._borders].copy()

    @property
    def total(self) -> Array:
        """Sum over all blocks that count: packed Gram matrix and riders."""
        return self._sums[0].copy() if self._borders else np.zeros(self._sums.shape[1])

    def revise(self, update: Callable[[Array], Array]) -> None:
        """Change what was summed, because the samples are now seen differently.

        Args:
            update: From the sums of all stretches that end now, shape (k, 190 + riders), to their new values.
        """
        if self._borders:
            self._sums[: self._borders] = update(self._sums[: self._borders])

    def push(self, block: int, gram: Array) -> None:
        """Take in a block: its number, larger than all before, and packed Gram matrix (190,), then the riders."""
        self._make_room()
        end = self._borders
        self._firsts[end], self._orders[end] = block, self._count
        self._sums[end] = 0.0
        self._borders += 1
        self._sums[: self._borders] += gram
        self._count += 1
        self._last_block = block

    def push_early(self, block: int, gram: Array) -> None:
        """Take in a block from before all others: its number, smaller than all before, and moments."""
        if not self._borders:
            return
        self._make_room()
        for array in (self._firsts, self._orders, self._sums):
            array[1 : 1 + self._borders] = array[: self._borders].copy()
        self._firsts[0], self._orders[0] = block, self._orders[1] - 1
        self._sums[0] += gram
        self._borders += 1
        self._has_early = True

    def _make_room(self) -> None:
        """For another border."""
        self._thin_out()
        if self._borders == len(self._firsts):
            self._firsts = np.concatenate([self._firsts, np.zeros_like(self._firsts)])
            self._orders = np.concatenate([self._orders, np.zeros_like(self._orders)])
            self._sums = np.concatenate([self._sums, np.zeros_like(self._sums)])

    def review(self, model: InertiaModel, is_coherent: bool = False) -> LoadChange | None:
        """Test whether the load changed at one of the borders; if so, forget all that is older than the likeliest one,
        until what is left is of one load.

        What has come early is tested at once, and not in turns: nothing was known of its load when it came; and so are
        all samples of a load while there are but few.

        Args:
            model: The weights.
            is_coherent: Whether disturbances now keep their direction all along.
        """
        self._reviews += 1
        turn, rest = divmod(self._reviews, self._every)
        everything = slice(1, self._borders)
        is_unknown = self._has_early or self._borders <= _YOUNG
        tested = everything if is_unknown else slice(1 + turn % self._stride, self._borders, self._stride)
        if rest and not is_unknown:
            return None
        self._has_early = False
        sizes = self._test(model, is_coherent, tested)
        change: LoadChange | None = None
        while sizes.max(initial=0.0) > 1.0:
            if len(sizes) < self._borders - 1:
                sizes = self._test(model, is_coherent, slice(1, self._borders))
            found = int(np.argmax(sizes))
            change = LoadChange(int(self._firsts[1 + found]), self._last_block, float(sizes[found]))
            self._begin(1 + found, change.size, model)
            sizes = self._test(model, is_coherent, slice(1, self._borders))
        return change

    def _test(self, model: InertiaModel, is_coherent: bool, borders: slice) -> Array:
        """Statistics of borders over what they hardly ever exceed by chance; keeps how doubtful they make the load."""
        statistics, seen = self._statistics(model, is_coherent, borders)
        is_doubtful = statistics > _threshold(seen, _CHANCE)
        newer = self._sums[borders, 0][is_doubtful]
        older = self._sums[0, 0] - newer
        # The smaller part may be the right one, from which the estimate is farther away.
        uneven = np.minimum(np.maximum(newer / older, older / newer), _UNEVEN)
        self._doubts.append(float((statistics[is_doubtful] * uneven).max(initial=max(seen, 1))) / max(seen, 1))
        return statistics / _threshold(seen, self._false_alarm)

    def statistics(self, model: InertiaModel) -> Array:
        """Twice the logarithm of the likelihood ratio at all ``borders`` but the first."""
        return self._statistics(model, False, slice(1, self._borders))[0]

    def accept(self, block: int, model: InertiaModel) -> None:
        """Somebody else found a change: forget all blocks with smaller numbers."""
        border = int(np.searchsorted(self._firsts[: self._borders], block))
        if 0 < border < self._borders:
            statistics, seen = self._statistics(model, False, slice(border, border + 1))
            self._begin(border, float(statistics[0]) / _threshold(seen, self._false_alarm), model)
        else:
            self.forget_before(block)

    def _begin(self, border: int, size: float, model: InertiaModel) -> None:
        """Forget what is older than a border, but not how far the load has moved since the change before."""
        if self._changes and self._changes[-1][0] == self._count:  # one more in the same review
            size = max(size, self._changes.pop()[1])
        self._changes.append((self._count, size))
        older = model.information(self._sums[0, :GRAM_SIZE] - self._sums[border, :GRAM_SIZE])
        last = np.zeros(model.unknowns) if self._last is None else self._last
        ridge = _HARDLY * np.diag(older.uncompensated.diagonal())
        self._moved = np.asarray(np.linalg.solve(older.matrix + ridge, older.vector - older.matrix @ last))
        self._last = np.asarray(last + self._moved)
        self._doubts.clear()
        self.forget_before(int(self._firsts[border]))

    def forget_before(self, block: int) -> None:
        """Forget all blocks with smaller numbers, and those that cannot be told apart from them any more."""
        kept = int(np.searchsorted(self._firsts[: self._borders], block))
        end = self._borders - kept
        for array in (self._firsts, self._orders, self._sums):
            array[:end] = array[kept : self._borders].copy()
        self._borders = end
        if end == 0:
            self._doubts.clear()

    def forget_since(self, block: int) -> None:
        """Forget all blocks from this one on, and those that cannot be told apart from them any more."""
        kept = int(np.searchsorted(self._firsts[: self._borders], block, side="right")) - 1
        if kept <= 0:
            self._borders = 0
        else:
            self._sums[:kept] -= self._sums[kept]
            self._borders = kept

    def forget_borders_before(self, block: int) -> None:
        """Keep all samples, but do not look for changes before this block any more."""
        kept = int(np.searchsorted(self._firsts[: self._borders], block))
        if kept > 1:
            for array in (self._firsts, self._orders, self._sums):
                array[1 : 1 + self._borders - kept] = array[kept : self._borders].copy()
            self._borders -= kept - 1

    @property
    def drifting(self) -> bool:
        """Whether the load seems to change all the time: small changes keep coming, and the next is not overdue."""
        if len(self._changes) < _DRIFT or max(size for _, size in self._changes) > _SMALL:
            return False
        interval = (self._changes[-1][0] - self._changes[0][0]) / (_DRIFT - 1)
        return self._count - self._changes[-1][0] < _OVERDUE * interval

    def information(self, model: InertiaModel) -> InertiaInformation:
        """Of all blocks since the last change.

        While the load drifts, it can have moved on unnoticed by as much as between the last changes.
        """
        information = model.information(self.total[:GRAM_SIZE])
        if not self.drifting:
            return information
        score = information.matrix @ self._moved
        return replace(information, score_covariance=information.score_covariance + np.outer(score, score))

    def _disturbance(self, model: InertiaModel, sums: Array, is_coherent: bool) -> Array:
        """Covariance of what a disturbance adds to the scores of stretches (..., 190 + riders), shape (..., u, u)."""
        grams = sums[..., :GRAM_SIZE]
        if self._coherence == 0.0:
            return np.zeros((*grams.shape[:-1], model.unknowns, model.unknowns))
        share = 1.0 if is_coherent else np.minimum(1.0, self._coherence / np.maximum(grams[..., 0], 1.0))
        result: Array = (share * sums[..., GRAM_SIZE])[..., None, None] * model.disturbance(grams)
        return result

    def _thin_out(self) -> None:
        """Drop the newest border whose neighbours are close to each other for their age."""
        orders = self._orders[: self._borders]
        close = (orders[2:] - orders[:-2]) * self._resolution <= self._count - orders[2:]
        if close.any():
            drop = 1 + int(np.flatnonzero(close)[-1])
            for array in (self._firsts, self._orders, self._sums):
                array[drop : self._borders - 1] = array[drop + 1 : self._borders].copy()
            self._borders -= 1

    def _statistics(self, model: InertiaModel, is_coherent: bool, borders: slice) -> tuple[Array, int]:
        """Statistic of each border, chi-square if nothing changed, and its degrees of freedom.

        If the load is one, the score of the newer part, ``u = vector - matrix @ estimate`` with the estimate from all,
        has mean zero and a known covariance ``C``, and the statistic is ``u^T C^-1 u``. Without noise in the regressor
        this equals ``RSS(all) - RSS(older) - RSS(newer)``; with it, unlike that, it stays true when the load is at
        rest for a while, and noise is all there is to see.

        A disturbance adds to the scores of both parts, ``du = (1 - gain) dnewer - gain dolder``. What it adds in ``n``
        samples has a covariance ``n`` times as large as if it were new with every sample, or ``coherence`` times, if it
        turns after so many.
        """
        sums = self._sums[borders, :GRAM_SIZE]
        if len(sums) == 0:
            return np.empty(0), 0
        everything, newer = model.information(self._sums[0, :GRAM_SIZE]), model.information(sums)
        # In these coordinates the score covariance of everything is the identity, and its matrix diagonal.
        basis, _, shares = signal_directions(everything.matrix, _safe_score_covariance(everything), _TESTED)
        if len(basis) == 0:
            return np.zeros(len(sums)), 0
        matrix = basis @ newer.matrix @ basis.T
        gain = matrix / shares
        score = newer.vector @ basis.T - gain @ (basis @ everything.vector)
        own = basis @ _safe_score_covariance(newer) @ basis.T
        cross = gain @ own
        spread = own - cross - cross.swapaxes(-1, -2) + gain @ gain.swapaxes(-1, -2)
        one = np.eye(len(basis))
        rest = one - gain
        for share, stretches in ((rest, self._sums[borders]), (gain, self._sums[0] - self._sums[borders])):
            disturbance = basis @ self._disturbance(model, stretches, is_coherent) @ basis.T
            spread += share @ disturbance @ share.swapaxes(-1, -2)
        whitened = np.linalg.solve(spread + 1e-9 * one, score[..., None])[..., 0]
        statistics = (score * whitened).sum(axis=1)
        return statistics, len(basis)


def _threshold(freedom: int, probability: float) -> float:
    """What a statistic exceeds with this probability; what shows nothing exceeds nothing."""
    return chi_square_threshold(freedom, probability) if freedom else np.inf


def signal_directions(matrix: Array, covariance: Array, least: float) -> tuple[Array, Array, Array]:
    """The directions in which information is motion and not mostly its noise.

    Args:
        matrix: Of the information, shape (u, u).
        covariance: Of its vector, shape (u, u).
        least: Share of motion from which on a direction is returned.

    Returns:
        ``basis`` (r, u), ``dual`` (r, u) and ``shares`` (r,): ``basis @ vector`` has the identity as covariance,
        ``basis @ matrix @ basis.T == diag(shares)``, and ``dual @ theta`` are the unknowns in these coordinates.
    """
    scale = np.sqrt(covariance.diagonal())
    balanced = covariance / scale[:, None] / scale + 1e-12 * np.eye(len(scale))
    root = scale[:, None] * np.linalg.cholesky(balanced)
    whitening = np.linalg.inv(root)
    shares, directions = np.linalg.eigh(whitening @ matrix @ whitening.T)
    seen = shares > least
    return directions[:, seen].T @ whitening, directions[:, seen].T @ root.T, shares[seen]


def _safe_score_covariance(information: InertiaInformation) -> Array:
    """With the regressor's noise as expected on top of what it happened to be: in a few samples that can be nil."""
    result: Array = 2.0 * information.uncompensated - information.matrix
    return result

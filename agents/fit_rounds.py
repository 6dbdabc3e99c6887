"""When a team fits its poses: at blocks that everybody computes alike, from the one at which the sums began."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FitRound:
    """One fit of all poses; see ``agents.team`` for its steps.

    Attributes:
        number: From 0 on.
        tell: Block at which each tells its score,
        fit: at which the reference robot computes the new poses and tells them,
        switch: from which on samples are carried with them,
        map: at which the last block with old poses has left the sums,
        correct: and at which everybody has heard everybody's moments.
    """

    number: int
    tell: int
    fit: int
    switch: int
    map: int
    correct: int


class FitRounds:
    """One round after the other, ever rarer. Who joins late finds the round that is under way.

    Args:
        start: Block at which the sums began.
        under_way: Blocks from a sample's entering the sums to its leaving them.
        hearing: Blocks until everybody has heard everybody.
        shortest: Least number of blocks between two fits.
        share: By which the data are to grow between two fits.
    """

    def __init__(self, start: int, under_way: int, hearing: int, shortest: int, share: float) -> None:
        self._start = start
        self._under_way = under_way
        self._hearing = hearing
        self._shortest = shortest
        self._share = share
        self._round = self._from(0, start + under_way + shortest)

    def at(self, block: int) -> FitRound:
        """The round that is under way at a block, or else the next one; blocks may be skipped, but never go back."""
        while block > self._round.correct:
            fit = self._round.fit
            grown = round(self._share * (fit - self._start))
            self._round = self._from(
                self._round.number + 1, max(self._round.correct + 1, fit + grown, fit + self._shortest)
            )
        return self._round

    def _from(self, number: int, tell: int) -> FitRound:
        fit = tell + self._hearing
        switch = fit + self._hearing
        leaving = switch + self._under_way
        # One block more, for agents that look one block ahead before they take one in.
        return FitRound(number, tell, fit, switch, leaving, leaving + self._hearing + 1)

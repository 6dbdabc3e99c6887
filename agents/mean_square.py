"""How large vectors are on average."""

from __future__ import annotations


class MeanSquare:
    """Mean square of the norm of the vectors seen so far."""

    def __init__(self) -> None:
        self._sum = self._count = 0.0

    def add(self, squares: float, count: float) -> None:
        """Take in some vectors: the sum of their squares, and their number."""
        self._sum += squares
        self._count += count

    @property
    def mean(self) -> float:
        """The mean, 0 of none."""
        return self._sum / max(self._count, 1)

"""Answers that come too late: counted, and told now and then."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

TELL_EVERY = 5.0
"""Time between two lines about them [s]; they come in real time only."""


class LateAnswers:
    """References that were not there when their block was simulated.

    Attributes:
        count: How many, of all robots together.
    """

    def __init__(self) -> None:
        self.count = 0
        self._untold: Counter[str] = Counter()
        self._told_at: float | None = None

    def add(self, names: Sequence[str], time: float) -> str | None:
        """Count the robots that were too late for a block.

        Args:
            names: Of them; often none.
            time: When the block begins [s].

        Returns:
            What is to be told now: the first one, then how many there have been.
        """
        self.count += len(names)
        self._untold.update(names)
        if not self._untold:
            return None
        if self._told_at is None:
            text = f"{', '.join(names)} answered too late at {time:.2f} s; from here on this is counted"
        elif time >= self._told_at + TELL_EVERY:
            most, _ = self._untold.most_common(1)[0]
            text = f"{self.count} answers have come too late in the first {time:.1f} s; of the newest, most from {most}"
        else:
            return None
        self._untold.clear()
        self._told_at = time
        return text

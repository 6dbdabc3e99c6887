"""Counting and occasional reporting of answers that arrive too late."""

from collections import Counter
from collections.abc import Sequence

TELL_EVERY = 5.0
"""Time between two reports [s]; answers are late only in real time."""


class LateAnswers:
    """Counts references that had not arrived when their block was simulated."""

    def __init__(self) -> None:
        self.count = 0
        self._unreported: Counter[str] = Counter()
        self._reported_at: float | None = None

    def add(self, names: Sequence[str], time: float) -> str | None:
        """Count the robots whose references are late for a block that starts at ``time`` [s].

        It returns the text to report now, if any: the first late answer at once, later ones as a number.
        """
        self.count += len(names)
        self._unreported.update(names)
        if not self._unreported:
            return None
        if self._reported_at is None:
            text = f"{', '.join(names)} answered too late at {time:.2f} s; further late answers are counted"
        elif time >= self._reported_at + TELL_EVERY:
            most, _ = self._unreported.most_common(1)[0]
            text = f"{self.count} answers were late in the first {time:.1f} s; of the newest, most came from {most}"
        else:
            return None
        self._unreported.clear()
        self._reported_at = time
        return text

"""A recording as something that one can move about in: to each time belongs what there was to show then."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from itertools import accumulate

import msgspec

from coheft.app.run.heard import News
from coheft.app.view.model import ViewModel
from coheft.app.view.traces import WINDOW
from coheft.wire.messages.requests import Status


class Timeline:
    """A run that has been recorded.

    A view shows nothing that is older than its curves, so a jump needs no more of the past than that.

    Args:
        begin: How the run began.
        news: Simulated time [s] and what was heard then, in that order.

    Attributes:
        end: Time of the last news [s].
        model: What there is to show now.
    """

    def __init__(self, begin: Status, news: Sequence[tuple[float, News]]) -> None:
        self._begin = msgspec.structs.replace(begin, real_time_factor=0.0)
        self._news = news
        self._times = list(accumulate((time for time, _ in news), max))
        self.end = self._times[-1] if self._times else 0.0
        self._restart(0.0)

    def _restart(self, time: float) -> None:
        self.model = ViewModel(self._begin)
        self._next = bisect_left(self._times, time - WINDOW)
        self.time = time

    def seek(self, time: float) -> ViewModel:
        """Go to a time [s] and return what there is to show."""
        if not self.time <= time <= self.time + WINDOW:
            self._restart(time)
        self.time = time
        for index in range(self._next, bisect_right(self._times, time)):
            self.model.hear(self._news[index][1])
            self._next = index + 1
        return self.model

    def note_playing(self, playing: bool) -> None:
        """Let the model say whether time runs."""
        state = "running" if playing else "paused" if self.time < self.end else "finished"
        if self.model.status.state != state:
            self.model.note_status(msgspec.structs.replace(self.model.status, state=state))

"""A recording with random access: the view model at any time."""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from itertools import accumulate

import msgspec

from coheft.app.run.heard import News
from coheft.app.view.model import ViewModel
from coheft.app.view.traces import WINDOW
from coheft.wire.messages.requests import Status
from coheft.wire.messages.states import RunState


class Timeline:
    """A recorded run.

    A view shows nothing older than its curves, so a jump replays only the messages of that time.

    Attributes:
        end: Time of the last message [s].
        model: The present state to show.
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
        """Go to a time [s]; return the view model."""
        if not self.time <= time <= self.time + WINDOW:
            self._restart(time)
        self.time = time
        for index in range(self._next, bisect_right(self._times, time)):
            self.model.receive(self._news[index][1])
            self._next = index + 1
        return self.model

    def note_playing(self, playing: bool) -> None:
        """Set the state in the model's status: running, paused or finished."""
        state = RunState.RUNNING if playing else RunState.PAUSED if self.time < self.end else RunState.FINISHED
        if self.model.status.state != state:
            self.model.note_status(msgspec.structs.replace(self.model.status, state=state))

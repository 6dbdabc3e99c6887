"""The view of a recording, with a time slider: the view model at any time."""

import threading
import time
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any

import msgspec
import viser

from coheft.app.recording.reader import read_recording
from coheft.app.run.news import News
from coheft.app.view.model import ViewModel
from coheft.app.view.page import FRAME, Page
from coheft.app.view.place import Place
from coheft.app.view.server import open_server
from coheft.app.view.traces import WINDOW
from coheft.wire.messages.requests import RunState, Status

_SPEEDS = ("0.1 ×", "0.25 ×", "0.5 ×", "1 ×", "2 ×", "5 ×", "10 ×")
_STEP = 0.05  # of the time slider [s]


def view_recording(path: Path, place: Place, shown: Callable[[], None]) -> None:
    """Show a recording of 'coheft run --record' until Ctrl-C; other arguments as for ``live.view_run``."""
    recording = read_recording(path)
    timeline = Timeline(recording.begin, recording.news)
    with open_server(place) as server:
        page = Page(server, timeline.model)
        player = Player(page, timeline.end)
        shown()
        before = time.monotonic()
        while True:
            now = time.monotonic()
            timeline.seek(player.advance(now - before))
            before = now
            timeline.note_playing(player.is_playing)
            page.draw(timeline.model, f"a recording: {path.name}")
            time.sleep(max(0.0, FRAME - (time.monotonic() - now)))


class Timeline:
    """A recorded run.

    A view shows nothing older than its curves, so a jump replays only the messages of that time.

    Attributes:
        end: Time of the last message [s].
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

    def seek(self, time: float) -> None:
        """Go to a time [s]."""
        if not self.time <= time <= self.time + WINDOW:
            self._restart(time)
        self.time = time
        for index in range(self._next, bisect_right(self._times, time)):
            self.model.receive(self._news[index][1])
            self._next = index + 1

    def note_playing(self, playing: bool) -> None:
        """Set the state in the model's status: running, paused or finished."""
        state = RunState.RUNNING if playing else RunState.PAUSED if self.time < self.end else RunState.FINISHED
        if self.model.status.state != state:
            self.model.note_status(msgspec.structs.replace(self.model.status, state=state))


class Player:
    """Controls of the replay, and its present time."""

    def __init__(self, page: Page, end: float) -> None:
        self._end = end
        self._time = 0.0
        self._lock = threading.Lock()
        self.is_playing = True
        gui = page.server.gui
        with page.controls:
            self._slider: Any = gui.add_slider("Time, s", 0.0, max(end, _STEP), _STEP, 0.0)
            self._button = gui.add_button("Pause", icon=viser.Icon.PLAYER_PAUSE)
            self._speed = gui.add_dropdown("Speed", _SPEEDS, initial_value="1 ×")

        @self._slider.on_update
        def _(event: Any) -> None:
            if event.client is not None:  # not when the replay moves it
                with self._lock:
                    self._time = float(self._slider.value)

        @self._button.on_click
        def _(_: object) -> None:
            with self._lock:
                if not self.is_playing and self._time >= self._end:
                    self._time = 0.0
                self._set_playing(not self.is_playing)

    def advance(self, seconds: float) -> float:
        """Advance by a wall-clock time [s]; return the time in the recording [s]."""
        with self._lock:
            if self.is_playing:
                self._time = min(self._end, self._time + seconds * float(self._speed.value.split()[0]))
                self._slider.value = round(self._time / _STEP) * _STEP
                if self._time >= self._end:
                    self._set_playing(False)
            return self._time

    def _set_playing(self, playing: bool) -> None:
        self.is_playing = playing
        self._button.label = "Pause" if playing else "Play"
        self._button.icon = viser.Icon.PLAYER_PAUSE if playing else viser.Icon.PLAYER_PLAY

"""Log of events in a run: loads that are added or removed, robots that notice it, estimates that become stale."""

from collections.abc import Iterator

from coheft.app.recording import ros
from coheft.app.results.states import State
from coheft.app.run.news import News
from coheft.wire.messages.structs import Estimate, Problem
from coheft.wire.messages.truth import LoadState, Truth
from coheft.wire.transport.planes import SERVER


class LogBook:
    """Turns messages into log lines for new events: source, level and text."""

    def __init__(self) -> None:
        self._loads: dict[int, LoadState] | None = None
        self._states: dict[str, str] = {}
        self._logged: set[tuple[str, str]] = set()

    def lines(self, news: News) -> Iterator[tuple[str, int, str]]:
        """Yield a line for each new event in a message."""
        match news:
            case Truth():
                yield from self._load_lines({load.id: load for load in news.loads})
            case Estimate():
                yield from self._robot_lines(news)
            case Problem():
                yield news.source, ros.WARN, news.text

    def _load_lines(self, loads: dict[int, LoadState]) -> Iterator[tuple[str, int, str]]:
        before = loads if self._loads is None else self._loads
        for number, load in loads.items():
            if number not in before:
                place = ", ".join(f"{value:g}" for value in load.position)
                yield SERVER, ros.INFO, f"load {number} of {load.mass:g} kg is added at ({place}) m"
        for number in before:
            if number not in loads:
                yield SERVER, ros.INFO, f"load {number} is removed"
        self._loads = loads

    def _robot_lines(self, estimate: Estimate) -> Iterator[tuple[str, int, str]]:
        name = estimate.robot
        events = [f"notices at {each.noticed_at:.2f} s that the load has changed" for each in estimate.load_changes]
        events += [f"finds at {s.named_at:.2f} s that the grasp of {s.robot} has slipped" for s in estimate.slips]
        for text in events:
            if (name, text) not in self._logged:
                self._logged.add((name, text))
                yield name, ros.INFO, text
        state = State.of(estimate)
        if state != self._states.get(name):
            self._states[name] = state
            reasons = f": {'; '.join(estimate.reasons)}" if estimate.reasons else ""
            yield name, ros.WARN if state is State.STALE else ros.INFO, f"is {state}{reasons}"

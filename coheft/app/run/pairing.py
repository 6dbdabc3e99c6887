"""Pairing of estimates with the truth of their block, whichever arrives first."""

from collections import deque
from collections.abc import Iterable, Sequence

from coheft.app.results.judge import Judge
from coheft.app.run.news import News
from coheft.wire.messages.structs import Estimate, EstimateBeside
from coheft.wire.messages.truth import Scene, Truth

REMEMBERED = 1000
"""Number of blocks by which an estimate, and its total wrench, may arrive later than the truth."""

_Key = tuple[str, str]
"""Names of an estimator and a robot."""


class Pairing:
    """Pairs estimates with truths, in an order that does not depend on which arrived first; ``truth`` is the newest.

    ``estimators`` are the names of those that run side by side, the robots' own first.
    """

    def __init__(self, scene: Scene, estimators: Sequence[str]) -> None:
        self.judge = Judge(scene)
        self.truth: Truth | None = None
        self._own = estimators[0]
        self._waiting: dict[_Key, deque[Estimate]] = {
            (estimator, name): deque(maxlen=REMEMBERED) for estimator in estimators for name in scene.robots
        }

    def receive(self, news: News) -> list[tuple[str, Estimate]]:
        """Process a message; return the estimates that can be compared now, each after the name of its estimator."""
        match news:
            case Truth():
                self.truth = news
                self.judge.add(news, remember=REMEMBERED)
                return self._ready(self._waiting)
            case Estimate(robot=robot):
                key, estimate = (self._own, robot), news
            case EstimateBeside(estimate=estimate):
                key = (estimate.estimator, estimate.robot)
            case _:
                return []
        if key not in self._waiting:
            return []
        self._waiting[key].append(estimate)
        return self._ready([key])

    def _ready(self, keys: Iterable[_Key]) -> list[tuple[str, Estimate]]:
        ready = []
        for key in keys:
            waiting = self._waiting[key]
            while waiting and self.truth is not None and waiting[0].block <= self.truth.block:
                ready.append((key[0], waiting.popleft()))
        return ready

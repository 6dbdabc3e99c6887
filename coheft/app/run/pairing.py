"""Pairing of estimates with the truth of their block, whichever arrives first."""

from collections import deque

from coheft.app.results.judge import Judge
from coheft.wire.messages.scene import Scene
from coheft.wire.messages.structs import Estimate
from coheft.wire.messages.truth import Truth

REMEMBERED = 1000
"""Number of blocks by which an estimate, and its total wrench, may arrive later than the truth."""


class Pairing:
    """Pairs estimates with truths, in an order that does not depend on which arrived first; ``truth`` is the newest."""

    def __init__(self, scene: Scene) -> None:
        self.judge = Judge(scene)
        self.truth: Truth | None = None
        self._waiting: dict[str, deque[Estimate]] = {name: deque(maxlen=REMEMBERED) for name in scene.robots}

    def add_truth(self, truth: Truth) -> list[Estimate]:
        """Add the truth of one more block; return the estimates that can be compared now."""
        self.truth = truth
        self.judge.add(truth, remember=REMEMBERED)
        return [estimate for name in self._waiting for estimate in self._ready(name)]

    def add_estimate(self, estimate: Estimate) -> list[Estimate]:
        """Add a robot's estimate; return the estimates that can be compared now."""
        self._waiting[estimate.robot].append(estimate)
        return self._ready(estimate.robot)

    def _ready(self, name: str) -> list[Estimate]:
        ready: list[Estimate] = []
        waiting = self._waiting[name]
        while waiting and self.truth is not None and waiting[0].block <= self.truth.block:
            ready.append(waiting.popleft())
        return ready

"""Deliberate bugs, put into running agents one at a time: a campaign that does not find them is worth nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np

from agents.inbox import NeighbourInbox
from agents.sums import Entered, TeamSums
from coheft.errors import CoheftError
from coheft.estimation.measurement import WRENCH
from coheft.estimation.spatial import Array
from coheft.estimation.stretches import Stretches
from coheft.wire.messages import NeighbourMessage
from consensus.pipeline import NeighbourStages, Pipeline

Method = Callable[..., Any]


def _half_done_sum(advance: Method) -> Method:
    """A sum is used although messages were missing on its way."""

    def mutant(self: Pipeline, neighbours: Sequence[NeighbourStages], own_gains: Array) -> Array | None:
        pretended = [
            replace(
                neighbour,
                stages=np.zeros_like(self.stages) if neighbour.stages is None else neighbour.stages,
                valid=np.ones(self.rounds, dtype=np.bool_),
            )
            for neighbour in neighbours
        ]
        result: Array | None = advance(self, pretended, own_gains)
        return result

    return mutant


def _wrong_tick(advance: Method) -> Method:
    """A total is paired with the samples of the block after it."""

    def mutant(self: TeamSums, inbox: Mapping[str, Mapping[str, Array]]) -> tuple[Entered, Array] | None:
        finished: tuple[Entered, Array] | None = advance(self, inbox)
        before = getattr(self, "stale", None)
        self.stale = finished  # type: ignore[attr-defined]
        return None if finished is None or before is None else (finished[0], before[1])

    return mutant


def _no_lever_arm(carried: Method) -> Method:
    """Torques are carried to the body frame as if all grasps lay in its origin."""

    def mutant(self: TeamSums, entered: Entered) -> Array:
        result: Array = carried(self, entered)
        wrench = entered.samples[:, WRENCH].reshape(-1, 2, 3) @ entered.pose.rotation.T
        result[:, :6] = wrench.reshape(-1, 6)
        return result

    return mutant


def _wrong_side(forget_before: Method) -> Method:
    """When the load has changed, what came after the change is forgotten."""

    def mutant(self: Stretches, block: int) -> None:
        kept = self.border(block)
        if 0 < kept < len(self):
            self.forget_since(int(self.firsts[kept]))

    return mutant


def _replayed_message(take: Method) -> Method:
    """Messages are taken for new, whatever number they bear."""

    def mutant(self: NeighbourInbox, index: int, messages: Sequence[NeighbourMessage], *rest: Any) -> Any:
        renumbered = [msgspec.structs.replace(message, block=index - 1) for message in messages]
        return take(self, index, renumbered, *rest)

    return mutant


MUTANTS: dict[str, tuple[type, str, Callable[[Method], Method]]] = {
    "half-done-sum": (Pipeline, "advance", _half_done_sum),
    "wrong-tick": (TeamSums, "advance", _wrong_tick),
    "no-lever-arm": (TeamSums, "_carried", _no_lever_arm),
    "wrong-side": (Stretches, "forget_before", _wrong_side),
    "replayed-message": (NeighbourInbox, "take", _replayed_message),
}
"""By name: whose method is replaced, and by what."""


def check_mutant(name: str) -> None:
    """Check that there is such a bug.

    Raises:
        CoheftError: There is none.
    """
    if name and name not in MUTANTS:
        raise CoheftError(f"there is no mutant {name!r}: there are {', '.join(MUTANTS)}")


@contextmanager
def mutated(name: str) -> Iterator[None]:
    """Within, agents have this bug; none if the name is empty."""
    if not name:
        yield
        return
    owner, method, mutate = MUTANTS[name]
    right = getattr(owner, method)
    setattr(owner, method, mutate(right))
    try:
        yield
    finally:
        setattr(owner, method, right)

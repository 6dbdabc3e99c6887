"""Deliberate bugs and guards that are switched off, put into running agents one at a time.

A campaign that does not find the bugs is worth nothing, and a guard whose absence it does not notice guards nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np

from coheft.agents.efficient import estimator, judge
from coheft.agents.efficient.exchange import Exchange
from coheft.agents.efficient.session import Session
from coheft.errors import CoheftError
from coheft.estimation.geometry.spatial import Array, skew
from coheft.estimation.moments.body import BodyModel
from coheft.estimation.moments.misfit import Explanations
from coheft.estimation.moments.moments import Moments
from coheft.estimation.moments.row_buffer import RowBuffer

Function = Callable[..., Any]


def _half_complete_row(complete: Function) -> Function:
    """A row of the team is used although rows of some robots are missing."""

    def mutant(self: Exchange, number: int) -> Array | None:
        is_begun = len(self.missing(number)) < self._count
        return self._rows[number % len(self._numbers)] if is_begun else None

    return mutant


def _wrong_row(complete: Function) -> Function:
    """This robot's own row is paired with the rows of the others before it."""

    def mutant(self: Exchange, number: int) -> Array | None:
        row: Array | None = complete(self, number)
        before = getattr(self, "before", None)
        if row is None:
            return None
        self.before = row.copy()  # type: ignore[attr-defined]
        if before is None:
            return row
        own = slice(24 * self._own, 24 * self._own + 24)
        before[own] = row[own]
        return before  # type: ignore[no-any-return]

    return mutant


def _no_lever_arm(set_wrench: Function) -> Function:
    """Forces make no torques about the origin of the body frame."""

    def mutant(self: BodyModel) -> None:
        set_wrench(self)
        lever = skew(self.places) @ self.rotations
        for robot, part in enumerate(np.split(self.wrench[:, :-1], self.count, axis=1)):
            part[3:, 12:15] -= lever[robot]

    return mutant


def _wrong_side(begin_load: Function) -> Function:
    """When the load has changed, the rows before the change count, too."""

    def mutant(self: RowBuffer, place: int) -> Moments:
        return begin_load(self, max(self.start, place - 20))  # type: ignore[no-any-return]

    return mutant


def _no_rival(explanations: Function) -> Function:
    """What looks like another load is one."""

    def mutant(*arguments: Any) -> Explanations:
        return Explanations(np.inf, 0.0, 0.0, 0, "force")

    return mutant


def _no_confirmation(is_confirmed: property) -> property:
    """What was known before rows were missing holds at once."""
    return property(lambda self: True)


def _without(guard: str) -> Callable[[Function], Function]:
    """A guard is switched off."""
    return lambda guards: partial(guards, **{guard: SWITCHED_OFF[guard]})


SWITCHED_OFF = {
    "surprise": 1e-300,
    "contradiction": 1e-300,
    "lasting": 1e9,
    "misfit": 1e-300,
    "tolerance": 1e-300,
    "energy": 1e9,
    "noise_tolerance": 0.0,
    "excess": 1e-300,
    "constant_excess": 1e-300,
    "fresh_change": 1e9,
    "calm": 0.0,
    "mass": 0.999,
    "waiting": 1e9,
    "first_rows": 0.0,
}
"""Values of guards that make them do nothing."""

MUTANTS: dict[str, tuple[Any, str, Callable[[Any], Any]]] = {
    "half-complete-row": (Exchange, "complete", _half_complete_row),
    "wrong-row": (Exchange, "complete", _wrong_row),
    "no-lever-arm": (BodyModel, "_set_wrench", _no_lever_arm),
    "wrong-side": (RowBuffer, "begin_load", _wrong_side),
    "no-rival": (judge, "explanations", _no_rival),
    "no-confirmation": (Session, "is_confirmed", _no_confirmation),
    **{f"without-{guard.replace('_', '-')}": (estimator, "Guards", _without(guard)) for guard in SWITCHED_OFF},
}
"""By name: where what is replaced, and by what."""


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
    owner, attribute, mutate = MUTANTS[name]
    right = getattr(owner, attribute)
    setattr(owner, attribute, mutate(right))
    try:
        yield
    finally:
        setattr(owner, attribute, right)

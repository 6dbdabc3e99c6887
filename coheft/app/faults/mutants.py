"""Deliberate bugs and disabled guards, put into running agents one at a time.

A campaign has to find the bugs. If a campaign does not notice that a guard is disabled, the guard is useless.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np

from coheft.agents.efficient import estimator, judge
from coheft.agents.efficient.change_detector import ChangeDetector, Confirmation
from coheft.agents.efficient.exchange import Exchange
from coheft.agents.efficient.knowledge import Knowledge
from coheft.agents.efficient.session import Session
from coheft.estimation.geometry.spatial import Array, skew
from coheft.estimation.moments.body import BodyModel
from coheft.estimation.moments.misfit import Explanations
from coheft.estimation.moments.row_buffer import RowBuffer

Function = Callable[..., Any]


def _half_complete_row(complete: Function) -> Function:
    """Use a row of the team although rows of some robots are missing."""

    def mutant(self: Exchange, number: int) -> Array | None:
        known = self._rows.get(number)
        if known is None:
            return None
        nothing = dict.fromkeys(range(self._count), bytes(4 * self._size))
        self._rows[number] = nothing | known
        row: Array | None = complete(self, number)
        self._rows[number] = known
        return row

    return mutant


def _wrong_row(complete: Function) -> Function:
    """Pair this robot's own row with the previous rows of the others."""

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


def _no_lever_arm(init: Function) -> Function:
    """Ignore the torques of forces about the origin of the body frame."""

    def mutant(self: BodyModel, *arguments: Any) -> None:
        init(self, *arguments)
        lever = skew(self.positions) @ self.rotations
        for robot, part in enumerate(np.split(self.wrench_map[:, :-1], self.count, axis=1)):
            part[3:, 12:15] -= lever[robot]

    return mutant


def _endless_confirmation(fits_badly: Function) -> Function:
    """Leave out wrenches that do not fit the load for as long as poses may explain them."""

    def mutant(self: Confirmation, number: int) -> bool:
        fits_badly(self, number)
        return False

    return mutant


def _rare_fits(refine: Function) -> Function:
    """Fit no more often than usual while new rows have to confirm what was known before."""

    def mutant(self: ChangeDetector, known: Knowledge, number: int) -> None:
        self.schedule.pause(until=number + self._rows.confirming)

    return mutant


def _without(guard: str) -> Callable[[Function], Function]:
    """Disable a guard."""
    return lambda guards: partial(guards, **{guard: SWITCHED_OFF[guard]})


SWITCHED_OFF = {
    "surprise": 1e-300,
    "contradiction": 1e-300,
    "lasting": 1e9,
    "after_gap": 1e9,
    "restless": 1e9,
    "misfit": 1e-300,
    "tolerance": 1e-300,
    "energy": 1e9,
    "noise_tolerance": 0.0,
    "offset": 1e-300,
    "undeclared": 1e-300,
    "fresh_change": 1e9,
    "mass": 0.999,
    "pose_step": 1e-300,
    "undecided": 0.0,
    "small_step": 1e-300,
    "shortest": 1e9,
    "mass_surprise": 1e-300,
    "recent_step": 1e-300,
    "small_step_fades": 0.0,
    "waiting": 1e9,
    "outdated": 1e9,
    "doubted": 1e-300,
    "first_rows": 0.0,
    "turn": 1e9,
    "worth_a_fit": 1.0,
    "undeclared_doubt": 1.0,
    "undeclared_lasts": 1e9,
    "calm": 0.0,
    "drifting": 0.0,
    "mistaken": 1.0,
    "telling_apart": 1e9,
    "confirming": 0.0,
}
"""Values with which guards have no effect."""

MUTANTS: dict[str, tuple[Any, str, Callable[[Any], Any]]] = {
    "half-complete-row": (Exchange, "complete", _half_complete_row),
    "wrong-row": (Exchange, "complete", _wrong_row),
    "no-lever-arm": (BodyModel, "__init__", _no_lever_arm),
    # After a load change, also use rows from before the change.
    "wrong-side": (RowBuffer, "begin_load", lambda right: lambda self, place: right(self, max(self.start, place - 20))),
    # Treat everything that looks like a load change as one.
    "no-rival": (judge, "explanations", lambda right: lambda *_: Explanations(np.inf, 0.0, 0, "force")),
    # Use earlier knowledge at once after rows were missing.
    "no-confirmation": (Session, "is_confirmed", lambda right: property(lambda self: True)),
    "endless-confirmation": (Confirmation, "fits_badly", _endless_confirmation),
    "rare-fits": (ChangeDetector, "_refine", _rare_fits),
    **{f"without-{guard.replace('_', '-')}": (estimator, "Guards", _without(guard)) for guard in SWITCHED_OFF},
}
"""By name: the object and attribute that is replaced, and its replacement."""


@contextmanager
def mutated(name: str) -> Iterator[None]:
    """Put a bug into all agents while the context lasts; none if the name is empty."""
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

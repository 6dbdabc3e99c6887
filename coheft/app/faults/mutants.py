"""Deliberate bugs, put into running agents one at a time: a campaign that does not find them is worth nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from coheft.errors import CoheftError

Undo = Callable[[], None]
MUTANTS: dict[str, Callable[[], Undo]] = {}


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
    undo = MUTANTS[name]() if name else (lambda: None)
    try:
        yield
    finally:
        undo()

"""Comparison of figures with the committed ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec

from benchmarks.figures import Figure
from coheft.errors import CoheftError

COMMITTED = Path(__file__).with_name("committed_ratios.json")
LIMIT = 1.3
"""Factor by which a figure may be worse than the committed one."""


class Committed(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A committed ratio."""

    value: float
    more_is_better: bool = False


@dataclass(frozen=True)
class Comparison:
    """A committed ratio and the present one; ``now`` is None if it was not measured."""

    name: str
    was: float
    now: float | None
    more_is_better: bool = False

    @property
    def worse(self) -> float:
        """Factor by which it is worse; below 1 if it is better."""
        if self.now is None:
            return float("inf")
        was, now = (self.now, self.was) if self.more_is_better else (self.was, self.now)
        return now / was if was > 0.0 else float("inf")

    @property
    def is_regression(self) -> bool:
        """Whether it is worse than allowed."""
        return not self.worse <= LIMIT  # also for NaN

    def __str__(self) -> str:
        if self.now is None:
            return f"{self.name}: was {self.was:.3g}, was not measured"
        return f"{self.name}: was {self.was:.3g}, is {self.now:.3g}, {self.worse:.2f} times as bad"


def compare(committed: Mapping[str, Committed], found: Mapping[str, Figure]) -> list[Comparison]:
    """Compare each committed ratio with the present one; the worst comes first."""
    compared = [
        Comparison(name, was.value, found[name].value if name in found else None, was.more_is_better)
        for name, was in committed.items()
    ]
    return sorted(compared, key=lambda each: -each.worse)


def better_of(first: Mapping[str, Figure], second: Mapping[str, Figure]) -> dict[str, Figure]:
    """Return the better of two measurements of each figure, because other load makes figures worse only."""
    chosen = {**first, **second}
    for name in first.keys() & second.keys():
        pick = max if first[name].more_is_better else min
        chosen[name] = pick(first[name], second[name], key=lambda figure: figure.value)
    return chosen


def load_committed(path: Path = COMMITTED) -> dict[str, Committed]:
    """Return the committed ratios by name.

    Raises:
        CoheftError: They cannot be read.
    """
    try:
        return msgspec.json.decode(path.read_bytes(), type=dict[str, Committed])
    except OSError as error:
        hint = "'python -m benchmarks.check --commit TABLE' makes it"
        raise CoheftError(f"{path}: cannot be read: {error.strerror}; {hint}") from error
    except msgspec.DecodeError as error:
        raise CoheftError(f"{path}: not a table of ratios: {error}") from error


def write_committed(found: Mapping[str, Figure], path: Path = COMMITTED) -> None:
    """Write figures as the committed ratios."""
    table = {name: Committed(float(f"{figure.value:.4g}"), figure.more_is_better) for name, figure in found.items()}
    path.write_bytes(msgspec.json.format(msgspec.json.encode(table)) + b"\n")

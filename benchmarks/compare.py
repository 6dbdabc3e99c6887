"""Comparison of ratios with the committed ones; the smaller a ratio, the better."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec

from benchmarks.figures import read_json

COMMITTED = Path(__file__).with_name("committed_ratios.json")
LIMIT = 1.3
"""Factor by which a ratio may be worse than the committed one."""


@dataclass(frozen=True)
class Comparison:
    """A committed ratio and the present one, which is NaN if it was not measured."""

    name: str
    was: float
    now: float

    @property
    def is_regression(self) -> bool:
        """Whether it is worse than allowed."""
        return not self.now <= LIMIT * self.was  # also for NaN

    def __str__(self) -> str:
        if math.isnan(self.now):
            return f"{self.name}: was {self.was:.3g}, was not measured"
        return f"{self.name}: was {self.was:.3g}, is {self.now:.3g}, {self.now / self.was:.2f} times as bad"


def compare(committed: Mapping[str, float], found: Mapping[str, float]) -> list[Comparison]:
    """Compare each committed ratio with the present one; the worst comes first."""
    compared = [Comparison(name, was, found.get(name, math.nan)) for name, was in committed.items()]
    return sorted(compared, key=lambda each: -math.inf if math.isnan(each.now) else -each.now / each.was)


def load_committed(path: Path = COMMITTED) -> dict[str, float]:
    """Return the committed ratios by name.

    Raises:
        CoheftError: They cannot be read.
    """
    return read_json(path, dict[str, float], "a table of ratios", "python -m benchmarks.check --commit TABLE")


def write_committed(found: Mapping[str, float], path: Path = COMMITTED) -> None:
    """Write ratios as the committed ones."""
    table = {name: float(f"{value:.4g}") for name, value in found.items()}
    path.write_bytes(msgspec.json.format(msgspec.json.encode(table)) + b"\n")

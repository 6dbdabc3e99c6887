"""Regression guard: measures some ratios, and fails if one is more than 1.3 times worse than the committed one.

The ratios are of quantities that were measured side by side. Those that are worse are measured once more, and the
better result counts. With --commit nothing is measured: the ratios of a table of 'python -m benchmarks',
build/bench/bench.json, are committed for later comparisons.
"""

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec

from benchmarks.command import run_command
from benchmarks.figures import guarded, load_results, read_json
from benchmarks.runner import GUARDED, measure_all

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
    """Return the committed ratios by name; raise ``CoheftError`` if they cannot be read."""
    return read_json(path, dict[str, float], "a table of ratios", "python -m benchmarks.check --commit TABLE")


def write_committed(found: Mapping[str, float], path: Path = COMMITTED) -> None:
    """Write ratios as the committed ones."""
    table = {name: float(f"{value:.4g}") for name, value in found.items()}
    path.write_bytes(msgspec.json.format(msgspec.json.encode(table)) + b"\n")


def check() -> int:
    """Measure and compare; return the exit status."""
    committed = load_committed()
    found = guarded(measure_all(GUARDED, "short"))
    worse = [each for each in compare(committed, found) if each.is_regression and each.name in found]
    if worse:
        print(f"once more, because of {'; '.join(map(str, worse))}", file=sys.stderr)
        names = {each.name.partition(":")[0] for each in worse}
        again = guarded(measure_all([name for name in GUARDED if name in names], "short"))
        # Other load makes ratios worse only.
        found |= {name: min(value, found.get(name, value)) for name, value in again.items()}
    comparisons = compare(committed, found)
    for each in comparisons:
        print(f"{'WORSE ' if each.is_regression else 'ok    '}{each}")
    for name in sorted(found.keys() - committed.keys()):
        print(f"new   {name}: {found[name]:.3g}; not compared with anything yet, see --commit")
    count = sum(each.is_regression for each in comparisons)
    if count:
        ratios = f"{count} of {len(comparisons)} ratios"
        print(f"{ratios} are more than {LIMIT:g} times worse than committed", file=sys.stderr)
    return 1 if count else 0


def main(*, commit: Path | None = None) -> int:
    """Check, or commit ratios.

    Args:
        commit: Commit the ratios of this table.
    """
    if commit is None:
        return check()
    write_committed(guarded(load_results(commit).sections))
    return 0


if __name__ == "__main__":
    run_command(main, __doc__)

"""Regression guard: measures some ratios, and fails if one is more than 1.3 times worse than the committed one.

The ratios are of quantities that were measured side by side. Those that are worse are measured once more, and the
better result counts. With --commit nothing is measured: the ratios of a table of 'python -m benchmarks',
build/bench/bench.json, are committed for later comparisons.
"""

from __future__ import annotations

import sys
from pathlib import Path

from benchmarks.command import run_command
from benchmarks.compare import LIMIT, compare, load_committed, write_committed
from benchmarks.figures import guarded, load_results
from benchmarks.runner import GUARDED, measure_all


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

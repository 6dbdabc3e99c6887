"""All benchmarks, one after another; writes the results as Markdown and JSON after each one.

'usual' takes some minutes, 'full' most of an hour. If one fails, the others are still measured; the exit status is 1.
"""

import os
from pathlib import Path

from benchmarks.command import run_command
from benchmarks.figures import Effort, Results, Section
from benchmarks.runner import BENCHMARKS, Benchmark, measure_all, this_machine


def main(*names: Benchmark, effort: Effort = "usual", to: Path = Path("build/bench")) -> int:
    """Run benchmarks, write the results, and print the table.

    Args:
        names: Some of the benchmarks; all by default.
        effort: How much to measure.
        to: Folder for the tables.
    """
    load_before = os.getloadavg()[0]
    sections: list[Section] = []
    for section in measure_all(names or BENCHMARKS, effort):
        sections.append(section)
        results = Results(effort=effort, machine=this_machine(load_before), sections=sections)
        paths = results.write(to)  # each time, so that no result is lost
    print(results.markdown())
    print("Written:", *paths)
    return 1 if any(section.has_failed for section in sections) else 0


if __name__ == "__main__":
    run_command(main, __doc__)

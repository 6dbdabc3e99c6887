"""All benchmarks, one after another; writes the results as Markdown and JSON after each one.

    python -m benchmarks [NAME ...] [--effort short|usual|full] [--to FOLDER]

'usual' takes some minutes, 'full' most of an hour. If one fails, the others are still measured; the exit status is 1.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from benchmarks.figures import Results, Section
from benchmarks.runner import BENCHMARKS, add_effort, measure_all, this_machine


def main() -> None:
    """Run benchmarks, write the results, and print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", metavar="NAME", nargs="*", help=f"some of {', '.join(BENCHMARKS)}; all by default")
    parser.add_argument("--to", metavar="FOLDER", type=Path, default=Path("build/bench"), help="where to write tables")
    add_effort(parser)
    chosen = parser.parse_args()
    unknown = sorted(set(chosen.names) - set(BENCHMARKS))
    if unknown:
        parser.error(f"there is no benchmark {', '.join(unknown)}; available: {', '.join(BENCHMARKS)}")
    load_before = os.getloadavg()[0]
    sections: list[Section] = []
    try:
        for section in measure_all(chosen.names or BENCHMARKS, chosen.effort):
            sections.append(section)
            results = Results(effort=chosen.effort, machine=this_machine(load_before), sections=sections)
            paths = results.write(chosen.to)  # each time, so that no result is lost
    except OSError as error:
        sys.exit(str(error))
    except KeyboardInterrupt:
        sys.exit(130)
    print(results.markdown())
    print("Written:", *paths)
    sys.exit(1 if any(section.has_failed for section in sections) else 0)


if __name__ == "__main__":
    main()

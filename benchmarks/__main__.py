"""All benchmarks, one after another; writes a Markdown table and the same as JSON.

    python -m benchmarks [NAME ...] [--effort short|usual|full] [--to FOLDER]

'usual' takes some minutes, 'full' most of an hour. Each runs alone, too: python -m benchmarks.NAME --help
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.runner import BENCHMARKS, add_effort, measure_all
from coheft.errors import CoheftError


def main() -> None:
    """Run them, write the tables, print one."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", metavar="NAME", nargs="*", help=f"some of {', '.join(BENCHMARKS)}; all by default")
    parser.add_argument("--to", metavar="FOLDER", type=Path, default=Path("build/bench"), help="where to write tables")
    add_effort(parser)
    chosen = parser.parse_args()
    unknown = sorted(set(chosen.names) - set(BENCHMARKS))
    if unknown:
        parser.error(f"there is no benchmark {', '.join(unknown)}; there are {', '.join(BENCHMARKS)}")
    try:
        results = measure_all(chosen.names or BENCHMARKS, chosen.effort)
        paths = results.write(chosen.to)
    except (CoheftError, OSError) as error:
        sys.exit(str(error))
    except KeyboardInterrupt:
        sys.exit(130)
    print(results.markdown())
    print("Written:", *paths)


if __name__ == "__main__":
    main()

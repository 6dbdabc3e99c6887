"""Runs benchmarks, alone or all of them."""

from __future__ import annotations

import argparse
import importlib
import os
import platform
import sys
import time
from collections.abc import Sequence
from typing import get_args

import numpy as np
from msgspec.structs import replace

from benchmarks.figures import Effort, Machine, Results, Section, Skipped, section_lines
from coheft.errors import CoheftError

GUARDED = ("kernels", "startup", "inprocess", "floor")
"""Benchmarks with figures that the regression guard compares."""
BENCHMARKS = (*GUARDED, "realtime", "rounds", "wide")


def measure(name: str, effort: Effort) -> Section:
    """Run one benchmark: the module of that name in this package."""
    began = time.monotonic()
    section: Section = importlib.import_module(f"benchmarks.{name}").measure(effort)
    return replace(section, seconds=time.monotonic() - began)


def measure_all(names: Sequence[str], effort: Effort) -> Results:
    """Run some benchmarks, one after another; tells on stderr which one is at work."""
    load_before = os.getloadavg()[0]
    sections = []
    for name in names:
        print(f"{name} …", file=sys.stderr, flush=True)
        try:
            sections.append(measure(name, effort))
        except CoheftError as error:  # the others can still be measured
            reason = " ".join(str(error).split())
            sections.append(Section(name=name, title=name, figures=[], skipped=[Skipped("all of it", reason)]))
        print(f"{name}: {sections[-1].seconds:.0f} s", file=sys.stderr, flush=True)
    machine = Machine(
        cores=os.cpu_count() or 1,
        python=platform.python_version(),
        numpy=np.__version__,
        load_before=load_before,
        load_after=os.getloadavg()[0],
    )
    return Results(effort=effort, machine=machine, sections=sections)


def add_effort(parser: argparse.ArgumentParser, default: Effort = "usual") -> None:
    """The flag that says how much to measure."""
    parser.add_argument("--effort", choices=get_args(Effort), default=default, help="how much to measure")


def run_alone(name: str, description: str | None) -> None:
    """The command ``python -m benchmarks.NAME``: measures, and prints the table."""
    parser = argparse.ArgumentParser(
        prog=f"python -m benchmarks.{name}",
        description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_effort(parser)
    chosen = parser.parse_args()
    try:
        print("\n".join(section_lines(measure(name, chosen.effort))))
    except CoheftError as error:
        sys.exit(f"{name}: {error}")
    except KeyboardInterrupt:
        sys.exit(130)

"""Runs benchmarks one after another."""

import importlib
import os
import platform
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from typing import Literal, get_args

import numpy as np
from msgspec.structs import replace

from benchmarks.figures import Effort, Machine, Section
from coheft.errors import CoheftError

Benchmark = Literal["startup", "floor", "secure", "realtime"]
BENCHMARKS: tuple[Benchmark, ...] = get_args(Benchmark)
GUARDED: tuple[Benchmark, ...] = ("startup", "floor")
"""Benchmarks with figures that the regression guard compares."""


def measure(name: str, effort: Effort) -> Section:
    """Run one benchmark: the module of that name in this package."""
    section: Section = importlib.import_module(f"benchmarks.{name}").measure(effort)
    return section


def measure_all(names: Sequence[str], effort: Effort) -> Iterator[Section]:
    """Yield the results of benchmarks, one after another; their progress and their errors go to stderr."""
    for name in names:
        print(f"{name} …", file=sys.stderr, flush=True)
        began = time.monotonic()
        try:
            section = measure(name, effort)
        except Exception as error:  # the others can still be measured
            reason = f"{type(error).__name__}: {error}"
            if isinstance(error, CoheftError):
                reason = str(error)
                print(reason, file=sys.stderr)
            else:
                traceback.print_exception(error)
            skipped = {"all of it": " ".join(reason.split())}
            section = Section(name=name, title=name, figures=[], skipped=skipped, has_failed=True)
        section = replace(section, seconds=time.monotonic() - began)
        print(f"{name}: {section.seconds:.0f} s", file=sys.stderr, flush=True)
        yield section


def this_machine(load_before: float) -> Machine:
    """Describe this machine and its load."""
    return Machine(
        cores=os.cpu_count() or 1,
        python=platform.python_version(),
        numpy=np.__version__,
        load_before=load_before,
        load_after=os.getloadavg()[0],
    )

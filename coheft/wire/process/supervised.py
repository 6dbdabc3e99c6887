"""How a process of a run begins and ends: told what to do on stdin, and never outliving whoever told it."""

from __future__ import annotations

import gc
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import NoReturn, TypeVar

import msgspec

from coheft.errors import CoheftError, PluginError, ScenarioError
from coheft.wire.data.replace import remove_parts
from coheft.wire.process.log import LOG, log_to_stderr
from coheft.wire.process.memory import give_back_memory

C = TypeVar("C", bound=msgspec.Struct)
BEAT = 0.2
"""Time between two signs of life of a supervisor that gives them [s]."""
_STOPPED = 1.5
"""A supervisor of which nothing has come for so long is stopped [s]."""
_beats: list[float] = []
"""When the last sign of life came, as ``time.monotonic()`` [s]; empty if none ever did."""
COMMENT_AFTER = 5.0
"""Who has not been met after so long may never come [s]: it is said whom the process waits for."""
ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1")
"""Environment of such a process, whatever numpy was built with: products are small, and processes fill the cores."""
UNUSABLE = 2
"""Exit status of a process that cannot use what it was told, or an estimator or a motion of the user's own that it was
told to use: to start it again would not help."""
KILLED_BY = 128
"""A process that a signal ended has this plus the signal's number as its exit status, as shells have it."""
TERMINATED = KILLED_BY + signal.SIGTERM
"""Exit status of a process that was told to end before it was done."""


def supervised_main(kind: type[C], run: Callable[[C], None]) -> NoReturn:
    """Read a configuration, one line of JSON, from stdin; run with it until done, or until stdin ends.

    SIGINT is left to the supervisor, who gets it too. The exit status is 0, 1 after an error that was foreseen,
    ``UNUSABLE``, or ``TERMINATED`` after SIGTERM.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(TERMINATED))
    log_to_stderr()
    try:
        config = msgspec.json.decode(sys.stdin.buffer.readline(), type=kind)
    except (msgspec.DecodeError, ScenarioError) as error:
        LOG.error("expected %s as one line of JSON on stdin: %s", kind.__name__, error)
        sys.exit(UNUSABLE)
    log_to_stderr(getattr(config, "log_level", "info"))
    _run_in_batches()
    give_back_memory()
    gc.collect()
    gc.freeze()  # what has been imported stays: to look through it again and again takes a tenth of a process's time
    threading.Thread(target=_leave_with_stdin, daemon=True).start()
    try:
        run(config)
    except CoheftError as error:
        LOG.error("%s", error)
        sys.exit(UNUSABLE if isinstance(error, PluginError) else 1)
    sys.exit(0)


def is_supervisor_stopped() -> bool:
    """Whether a supervisor that gave signs of life does so no more, though it is there."""
    return bool(_beats) and time.monotonic() - _beats[0] > _STOPPED


def _run_in_batches() -> None:
    """Let this process, and all threads it starts from now on, finish what they are at before others of their kind.

    Where there are more processes than cores, each would interrupt the others with every message, and find its caches
    cold again. A process that finds a core idle starts at once all the same.
    """
    if sys.platform == "linux":
        with suppress(OSError):  # some containers forbid it
            os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))


def _leave_with_stdin() -> None:
    """Wait for the end of stdin, then leave at once: whoever wanted the run is gone."""
    while os.read(sys.stdin.fileno(), 4096):
        _beats[:] = [time.monotonic()]
    with suppress(OSError):
        remove_parts()
    os._exit(0)

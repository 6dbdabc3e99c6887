"""Start and end of a process of a run: it reads its configuration from stdin, and ends when stdin is closed."""

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
from coheft.wire.process.leave import leave
from coheft.wire.process.log import LOG, log_to_stderr
from coheft.wire.process.memory import give_back_memory

C = TypeVar("C", bound=msgspec.Struct)
BEAT = 0.2
"""Time between two heartbeats of a supervisor that sends them [s]."""
_STOPPED = 1.5
"""Time without a heartbeat after which the supervisor counts as stopped [s]."""
_beats: list[float] = []
"""Time of the last heartbeat, as ``time.monotonic()`` [s]; empty if there was none."""
STOP = b"stop\n"
"""Line on stdin with which a supervisor asks for the end of the run."""
_stop_asked = threading.Event()
COMMENT_AFTER = 5.0
"""Time after which a process logs what it is still waiting for [s]."""
ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1")
"""Environment variables that limit numerical libraries to one thread: matrices are small, and processes use all
cores."""
UNUSABLE = 2
"""Exit status of a process that cannot use its configuration, or a user's estimator or motion named there: restarting
it would not help."""
KILLED_BY = 128
"""A process that a signal ended has this plus the signal's number as its exit status, as in shells."""
TERMINATED = KILLED_BY + signal.SIGTERM
"""Exit status of a process that was terminated before it was done."""


def supervised_main(kind: type[C], run: Callable[[C], None]) -> NoReturn:
    """Read a configuration, one line of JSON, from stdin; run with it until done, or until stdin is closed.

    SIGINT is ignored, because the supervisor receives it, too. The exit status is 0, 1 after a ``CoheftError``,
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
    _use_batch_scheduling()
    give_back_memory()
    gc.collect()
    gc.freeze()  # imported modules stay: collecting them repeatedly takes a tenth of a process's time
    threading.Thread(target=_exit_with_stdin, daemon=True).start()
    status = 0
    try:
        run(config)
    except CoheftError as error:
        LOG.error("%s", error)
        status = UNUSABLE if isinstance(error, PluginError) else 1
    except SystemExit as end:  # on SIGTERM, or by a user's estimator
        status = end.code if isinstance(end.code, int) else 1
    leave(status)


def is_supervisor_stopped() -> bool:
    """Whether a supervisor that sent heartbeats has stopped doing so, although stdin is still open."""
    return bool(_beats) and time.monotonic() - _beats[0] > _STOPPED


def has_supervisor_asked_to_stop() -> bool:
    """Whether the supervisor has asked for the end of the run."""
    return _stop_asked.is_set()


def _use_batch_scheduling() -> None:
    """Let this process and its threads finish their work before others of the same scheduling class interrupt them.

    With more processes than cores, each message would otherwise interrupt another process, which then finds its caches
    cold. An idle core is still used at once.
    """
    if sys.platform == "linux":
        with suppress(OSError):  # not permitted in some containers
            os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))


def _exit_with_stdin() -> None:
    """Wait for the end of stdin, then exit at once, because the supervisor is gone."""
    while lines := os.read(sys.stdin.fileno(), 4096):
        _beats[:] = [time.monotonic()]
        if STOP in lines:
            _stop_asked.set()
    with suppress(OSError):
        remove_parts()
    os._exit(0)

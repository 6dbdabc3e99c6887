"""Return of free memory to the system, so that processes do not grow in a long run.

The C library's allocator on Linux keeps free memory between allocated objects: a few bytes per block, without limit. It
also keeps a separate heap for every thread, so that memory freed by one of Zenoh's threads cannot be used by another.
"""

import ctypes
import threading
import time
from collections.abc import Callable

_EVERY = 20.0
"""Time between two trims [s]; each takes some milliseconds."""
_HEAPS = -8
"""``M_ARENA_MAX``, the parameter of ``mallopt`` for the largest number of heaps."""


def give_back_memory() -> None:
    """Let all threads share one heap, and return free memory to the system regularly, where the C library can.

    To be called before threads are started.
    """
    trim = trimming()
    if trim is not None:
        ctypes.CDLL(None).mallopt(_HEAPS, 1)
        threading.Thread(target=_keep_trimming, args=(trim,), daemon=True).start()


def trimming() -> Callable[[], object] | None:
    """Return a function that returns free memory to the system at once; None if the platform has none."""
    try:
        malloc_trim = ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError, TypeError):
        return None
    return lambda: malloc_trim(0)


def _keep_trimming(trim: Callable[[], object]) -> None:
    while True:
        time.sleep(_EVERY)
        trim()

"""Memory that is free goes back to the system, so that processes do not grow in the course of a long run.

The allocator of the C library on Linux keeps what is free between things that stay: a few bytes per block, without end.
And it keeps a heap for every thread: what one of Zenoh's threads has freed, another one cannot use.
"""

from __future__ import annotations

import ctypes
import threading
import time
from collections.abc import Callable

_EVERY = 20.0
"""It takes some milliseconds each time [s]."""
_HEAPS = -8
"""What ``mallopt`` calls the largest number of heaps."""


def give_back_memory() -> None:
    """From now on let all threads share one heap, and give free memory back now and then, where the C library can.

    To be called before there are threads.
    """
    trim = trimming()
    if trim is not None:
        ctypes.CDLL(None).mallopt(_HEAPS, 1)
        threading.Thread(target=_keep_trimming, args=(trim,), daemon=True).start()


def trimming() -> Callable[[], object] | None:
    """What gives free memory back at once; None where there is no such thing, or no need."""
    try:
        malloc_trim = ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError, TypeError):
        return None
    return lambda: malloc_trim(0)


def _keep_trimming(trim: Callable[[], object]) -> None:
    while True:
        time.sleep(_EVERY)
        trim()

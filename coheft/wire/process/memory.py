"""Return of free memory to the system: regularly, so that processes do not grow, but not each time that some is freed.

The C library's allocator on Linux keeps free memory between allocated objects: a few bytes per block, without limit. It
also keeps a separate heap for every thread, so that memory freed by one of Zenoh's threads cannot be used by another.
What is larger, such as the matrices of a fit, it returns at once, and the system zeroes each page again for the next.
"""

import ctypes
import threading
import time
from collections.abc import Callable

_EVERY = 20.0
"""Time between two trims [s]; each takes some milliseconds."""
_KEPT_AT_END, _MAPPED_ALONE, _HEAPS = -1, -3, -8
"""Parameters of ``mallopt``: ``M_TRIM_THRESHOLD``, ``M_MMAP_THRESHOLD`` and ``M_ARENA_MAX``."""
_LARGE = 4 << 20
"""Size from which on memory is returned at once when it is freed [B]."""


def give_back_memory() -> None:
    """Let all threads share one heap, and return free memory to the system regularly, where the C library can.

    To be called before threads are started.
    """
    reuse_memory()
    trim = trimming()
    if trim is not None:
        ctypes.CDLL(None).mallopt(_HEAPS, 1)
        threading.Thread(target=_keep_trimming, args=(trim,), daemon=True).start()


def reuse_memory() -> None:
    """Keep freed memory for what is allocated next, where the C library can; this saves up to a fifth of fits' time."""
    if trimming() is not None:
        library = ctypes.CDLL(None)
        if library.mallopt(_MAPPED_ALONE, _LARGE):  # it may be too large for 32 bits, and the other one is no use alone
            library.mallopt(_KEPT_AT_END, 2 * _LARGE)


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

"""Threads that Zenoh calls us from keep what Python needs to know of them."""

from __future__ import annotations

import ctypes
import sys
import threading

_kept = threading.local()


def keep_thread_state() -> None:
    """Let the calling thread, if Zenoh has started it, keep its Python state until it ends; to be called in a callback.

    Python makes a state for a thread that it does not know, and drops it when the callback returns: with each message
    that takes memory from the system, a page fault, and gives it back. One more hold on the state, which is never let
    go, keeps it (``PyGILState_Ensure`` in the Python/C API). Other implementations of Python do without.
    """
    if not hasattr(_kept, "is_kept"):
        _kept.is_kept = True
        if sys.implementation.name == "cpython":
            ctypes.pythonapi.PyGILState_Ensure()

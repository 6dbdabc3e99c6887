"""Persistent Python state for threads from which Zenoh calls Python."""

from __future__ import annotations

import ctypes
import sys
import threading

_state = threading.local()


def keep_thread_state() -> None:
    """Keep the Python state of the calling thread until it ends, if Zenoh has started it; to be called in a callback.

    Python creates a state for a thread that it does not know, and deletes it when the callback returns. With each
    message this takes memory from the system and gives it back, which causes page faults. One additional reference to
    the state, which is never released, keeps it (``PyGILState_Ensure`` in the Python/C API). Other implementations of
    Python do not need this.
    """
    if not hasattr(_state, "is_kept"):
        _state.is_kept = True
        if sys.implementation.name == "cpython":
            ctypes.pythonapi.PyGILState_Ensure()

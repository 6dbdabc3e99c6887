"""A clock on the wall that a test sets."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import pytest


@dataclass
class WallClock:
    """What a module takes for the time [s]."""

    time: float = 0.0


def wall_clock_of(module: str, monkeypatch: pytest.MonkeyPatch) -> WallClock:
    """The clock of a module that asks for ``time.monotonic()``."""
    clock = WallClock()
    monkeypatch.setattr(f"{module}.time", SimpleNamespace(monotonic=lambda: clock.time))
    return clock

"""Lists of names in sentences."""

from __future__ import annotations

from collections.abc import Sequence

_MOST = 8


def few(names: Sequence[str]) -> str:
    """List names, the first ones only if there are many: large teams would fill the screen."""
    if len(names) <= _MOST:
        return ", ".join(names)
    return f"{', '.join(names[: _MOST - 1])} and {len(names) - _MOST + 1} more"

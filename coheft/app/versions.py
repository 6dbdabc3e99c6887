"""What made a result: so that it can be made again."""

from __future__ import annotations

import platform
from importlib.metadata import version

import coheft

_PACKAGES = ("mujoco", "eclipse-zenoh", "numpy", "scipy", "msgspec")


def versions() -> dict[str, str]:
    """Versions of the programs that decide on a run's numbers, by name."""
    packages = {name: version(name) for name in _PACKAGES}
    system = f"{platform.system()} {platform.machine()}"
    return {"coheft": coheft.__version__, "python": platform.python_version(), **packages, "system": system}

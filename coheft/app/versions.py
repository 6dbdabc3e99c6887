"""Versions of the software that made a result, for reproducing it."""

import platform
from importlib.metadata import version

import coheft

_PACKAGES = ("mujoco", "eclipse-zenoh", "numpy", "scipy", "msgspec")


def versions() -> dict[str, str]:
    """Return the versions of the packages that determine a run's numbers, by name."""
    packages = {name: version(name) for name in _PACKAGES}
    system = f"{platform.system()} {platform.machine()}"
    return {"coheft": coheft.__version__, "python": platform.python_version(), **packages, "system": system}

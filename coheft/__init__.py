"""coheft: robots that hold a load together identify it by themselves.

>>> import coheft
>>> result = coheft.run("ring6", duration=30)
>>> result.robots["r1"].mass.estimate[-1]

Modules are loaded only when they are used.
"""

from __future__ import annotations

__version__ = "0.1.0"
TYPE_CHECKING = False
"""True for type checkers. Importing it from ``typing`` takes 5 ms, in which Ctrl-C would print a traceback."""

if TYPE_CHECKING:
    from typing import Any

    from coheft import estimators
    from coheft.api.export import export
    from coheft.api.files import load
    from coheft.api.identification import identify
    from coheft.api.result import Result
    from coheft.api.run import run, simulate
    from coheft.api.scenario import load_scenario
    from coheft.api.simulation import Simulation
    from coheft.api.tracks import PoseTrack, RobotResult, Track
    from coheft.app.identify.choices import Bounds
    from coheft.app.results.states import State
    from coheft.errors import CoheftError
    from coheft.wire.scenario.motion import Motion
    from coheft.wire.scenario.payload import Box, MassProperties, Payload
    from coheft.wire.scenario.schema import (
        Graph,
        Grasp,
        LoadChange,
        Perimeter,
        Robots,
        Scenario,
        Sensors,
    )

_HOMES = {
    "coheft.api.export": ("export",),
    "coheft.api.files": ("load",),
    "coheft.api.identification": ("identify",),
    "coheft.api.result": ("Result",),
    "coheft.api.run": ("run", "simulate"),
    "coheft.api.scenario": ("load_scenario",),
    "coheft.api.simulation": ("Simulation",),
    "coheft.api.tracks": ("PoseTrack", "RobotResult", "Track"),
    "coheft.app.identify.choices": ("Bounds",),
    "coheft.app.results.states": ("State",),
    "coheft.errors": ("CoheftError",),
    "coheft.wire.scenario.payload": ("Box", "MassProperties", "Payload"),
    "coheft.wire.scenario.motion": ("Motion",),
    "coheft.wire.scenario.schema": (*("Grasp", "Graph", "LoadChange", "Perimeter", "Robots", "Scenario", "Sensors"),),
}
"""Modules, and the public names in them."""
_MODULES = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "Bounds",
    "Box",
    "CoheftError",
    "Graph",
    "Grasp",
    "LoadChange",
    "MassProperties",
    "Motion",
    "Payload",
    "Perimeter",
    "PoseTrack",
    "Result",
    "RobotResult",
    "Robots",
    "Scenario",
    "Sensors",
    "Simulation",
    "State",
    "Track",
    "estimators",
    "export",
    "identify",
    "load",
    "load_scenario",
    "run",
    "simulate",
]


def __getattr__(name: str) -> Any:
    """Load a public name when it is used."""
    from importlib import import_module

    if name in _MODULES:
        return getattr(import_module(_MODULES[name]), name)
    if name == "estimators":
        return import_module("coheft.estimators")
    raise AttributeError(f"module 'coheft' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])

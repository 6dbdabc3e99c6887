"""Users' estimators and motions that are installed, and their names.

A package registers them as entry points of the groups in ``GROUPS``. Names are read from its metadata; it is imported
only where it is used.
"""

from __future__ import annotations

from traceback import walk_tb
from typing import TYPE_CHECKING, Any, Literal

from coheft.errors import PluginError, one_line

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint, EntryPoints

Kind = Literal["estimator", "motion"]
GROUPS: dict[Kind, str] = {"estimator": "coheft.estimators", "motion": "coheft.motions"}
BUILT_IN: dict[Kind, tuple[str, ...]] = {"estimator": ("efficient", "fan2017"), "motion": ()}
"""What comes with coheft, which users' plugins may not be named after; an estimator's settings have a section of its
name, and ``messages.size`` the size of its messages."""


def estimator_names(estimator: str) -> list[str]:
    """Return the names in a scenario's ``estimator``: usually one, several of estimators that run side by side."""
    return [name.strip() for name in estimator.split(",")]


def is_available(kind: Kind, name: str) -> bool:
    """Whether an estimator or motion of this name exists; installed packages are searched only if necessary."""
    return name in BUILT_IN[kind] or bool(_points(kind, name))


def available(kind: Kind) -> list[str]:
    """Return all names, the built-in ones first."""
    own = sorted({point.name for point in _installed(kind)} - set(BUILT_IN[kind]))
    return [*BUILT_IN[kind], *own]


def usable_in_run(estimator: str) -> list[str]:
    """Return the estimators that the robots of a run can use that started with ``estimator``.

    Of users' own only that one: settings of others are not there, and they may not be installed on all hosts.
    """
    return list(dict.fromkeys([*BUILT_IN["estimator"], estimator]))


def load_plugin(kind: Kind, name: str) -> Any:
    """Load what an installed package registers under a name.

    A ``PluginError`` says that no package registers it, that several do, or why it cannot be imported.
    """
    points = _points(kind, name)
    if not points:
        raise PluginError(f"no {kind} {name!r} is installed; there are: {', '.join(available(kind)) or 'none'}")
    if len(points) > 1:
        packages = ", ".join(f"{_package(point)} ({point.value})" for point in points)
        raise PluginError(f"several packages offer the {kind} {name!r}: {packages}; uninstall all but one")
    try:
        return points[0].load()
    except Exception as error:  # a user's module may raise anything
        raise PluginError(
            f"the {kind} {name!r}, {points[0].value} of {_package(points[0])}, cannot be imported: "
            f"{told(error, points[0].module)}{_moved(error)}"
        ) from error


def _moved(error: Exception) -> str:
    """Return a hint if a missing module or name has been moved."""
    name = error.name if isinstance(error, ImportError) else None
    if name is None or name.partition(".")[0] not in ("coheft", "agents", "consensus", "physics_server"):
        return ""
    return "; coheft's modules have moved into the package 'coheft': CHANGELOG.md lists them"


def told(error: Exception, module: str) -> str:
    """Describe an exception from a user's code in one line, with the place where it was raised.

    That is the last place in the package of the user's ``module``, rather than in code that it calls.
    """
    frames = [(frame, line) for frame, line in walk_tb(error.__traceback__)]
    package = module.partition(".")[0]
    theirs = [each for each in frames if each[0].f_globals.get("__name__", "").partition(".")[0] == package]
    place = ""
    if frames:
        frame, line = (theirs or frames)[-1]
        place = f" ({frame.f_code.co_filename}, line {line})"
    return f"{type(error).__name__}: {one_line(str(error))}{place}"


def _points(kind: Kind, name: str) -> list[EntryPoint]:
    """Return the entry points of a name; duplicates of a package that is on the path twice count once."""
    return list({point.value: point for point in _installed(kind) if point.name == name}.values())


def _installed(kind: Kind) -> EntryPoints:
    from importlib.metadata import entry_points  # slow to load, and most agents do not need it

    return entry_points(group=GROUPS[kind])


def _package(point: EntryPoint) -> str:
    return point.dist.name if point.dist is not None else "an unknown package"

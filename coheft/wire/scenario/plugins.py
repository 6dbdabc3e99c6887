"""Estimators and motions of the user's own: which are installed, and by which names.

A package offers them as entry points of the groups in ``GROUPS``. Names are read from its metadata; it is imported only
by whoever uses it.
"""

from __future__ import annotations

from traceback import walk_tb
from typing import TYPE_CHECKING, Any, Literal

from coheft.errors import PluginError, one_line

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint, EntryPoints

Kind = Literal["estimator", "motion"]
GROUPS: dict[Kind, str] = {"estimator": "coheft.estimators", "motion": "coheft.motions"}
SECTIONS = {"efficient": "efficient", "fan2017": "fan2017"}
"""Estimators that come with coheft, and where scenarios have their settings; ``messages.size`` tells what they send."""
BUILT_IN: dict[Kind, tuple[str, ...]] = {"estimator": tuple(SECTIONS), "motion": ()}
"""Names that are taken."""


def is_available(kind: Kind, name: str) -> bool:
    """Whether there is an estimator, or motion, of this name; packages are looked through only if need be."""
    return name in BUILT_IN[kind] or bool(_points(kind, name))


def available(kind: Kind) -> list[str]:
    """All names, the built-in ones first."""
    own = sorted({point.name for point in _installed(kind)} - set(BUILT_IN[kind]))
    return [*BUILT_IN[kind], *own]


def usable_in_run(estimator: str) -> list[str]:
    """Estimators that the robots of a run can use that has begun with ``estimator``.

    Of one's own only that one: settings of others are not there, and they may not be installed on all hosts.
    """
    return list(dict.fromkeys([*BUILT_IN["estimator"], estimator]))


def load_plugin(kind: Kind, name: str) -> Any:
    """What an installed package offers under a name.

    Raises:
        PluginError: No one offers it, or two packages do, or it cannot be imported.
    """
    points = _points(kind, name)
    if not points:
        raise PluginError(f"no {kind} {name!r} is installed; there are: {', '.join(available(kind)) or 'none'}")
    if len(points) > 1:
        packages = ", ".join(f"{_package(point)} ({point.value})" for point in points)
        raise PluginError(f"several packages offer the {kind} {name!r}: {packages}; uninstall all but one")
    try:
        return points[0].load()
    except Exception as error:  # whatever somebody else's module raises
        raise PluginError(
            f"the {kind} {name!r}, {points[0].value} of {_package(points[0])}, cannot be imported: "
            f"{told(error, points[0].module)}{_moved(error)}"
        ) from error


def _moved(error: Exception) -> str:
    """A hint if a module is not found that is somewhere else now, or a name of it."""
    name = error.name if isinstance(error, ImportError) else None
    if name is None or name.partition(".")[0] not in ("coheft", "agents", "consensus", "physics_server"):
        return ""
    return "; coheft's modules have moved into rooms of the one package coheft: CHANGELOG.md lists them"


def told(error: Exception, module: str) -> str:
    """An exception from somebody else's code in one line, with the place where it was raised.

    Args:
        error: The exception.
        module: Name of theirs. The last place in its package counts: what is wrong is there, not in what it calls.
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
    """Entry points of a name; one that is found twice, for its package is on the path twice, counts once."""
    return list({point.value: point for point in _installed(kind) if point.name == name}.values())


def _installed(kind: Kind) -> EntryPoints:
    from importlib.metadata import entry_points  # takes its time to load, and most agents do not need it

    return entry_points(group=GROUPS[kind])


def _package(point: EntryPoint) -> str:
    return point.dist.name if point.dist is not None else "an unknown package"

"""Creation of users' estimators and motions, with checks that an agent can use them."""

import inspect
from typing import Any

from coheft.errors import CoheftError, PluginError
from coheft.wire.scenario.plugins import Kind, load_plugin, told


def make_own(kind: Kind, name: str, protocol: type, *arguments: object) -> Any:
    """Make the object that an installed package registers under a name, and that has the protocol's methods.

    Raises:
        PluginError: It cannot be imported or made, or lacks a method.
    """
    factory = load_plugin(kind, name)
    try:
        made = factory(*arguments)
    except CoheftError:
        raise
    except Exception as error:  # a user's code may raise anything
        raise PluginError(
            f"the {kind} {name!r} cannot be made from {', '.join(type(a).__name__ for a in arguments)}, or not with "
            f"the settings in [settings.{name}]: {told(error, getattr(factory, '__module__', ''))}"
        ) from error
    for method, expected in inspect.getmembers(protocol, inspect.isfunction):
        if not method.startswith("_"):
            _check_method(made, method, expected, f"the {kind} {name!r}")
    return made


def _check_method(made: object, method: str, expected: Any, what: str) -> None:
    """Check that a method exists and takes the arguments of the protocol, or raise a ``PluginError``."""
    wanted = [*inspect.signature(expected).parameters][1:]
    call = f"{method}({', '.join(wanted)})"
    found = getattr(made, method, None)
    if not callable(found):
        raise PluginError(f"{what}, a {type(made).__name__}, has no method {call}; see docs/own.md")
    try:
        inspect.signature(found).bind(*wanted)
    except ValueError:  # a compiled method may not tell its arguments
        return
    except TypeError as error:
        raise PluginError(
            f"{what}: its method {method}{inspect.signature(found)} cannot be called as {call}"
        ) from error

"""Rules for estimators and motions, and for the settings of your own ones."""

from collections.abc import Iterator

from coheft.errors import one_line
from coheft.wire.former_names import present
from coheft.wire.scenario.errors import did_you_mean
from coheft.wire.scenario.plugins import BUILT_IN, Kind, available, estimator_names, is_available
from coheft.wire.scenario.rules import Complaint
from coheft.wire.scenario.schema import Scenario
from coheft.wire.scenario.toml_value import as_toml

_KEYS: dict[Kind, str] = {"estimator": "estimator", "motion": "motion.own"}
"""Where a scenario names which it uses."""


def plugin_complaints(scenario: Scenario) -> Iterator[Complaint]:
    """Complain about estimators and motions that are not there, and settings of such, or that are of no use."""
    estimators = estimator_names(scenario.estimator)
    twice = [name for name in dict.fromkeys(estimators) if estimators.count(name) > 1]
    if twice:
        yield "estimator", f"found '{twice[0]}' twice, expected different estimators side by side"
    chosen: list[tuple[Kind, str | None]] = [("motion", scenario.motion.own)]
    chosen += [("estimator", name) for name in estimators]
    for kind, name in chosen:
        if name is not None and not is_available(kind, name):
            there = available(kind)
            yield (
                _KEYS[kind],
                f"found {name!r}, expected one of: {', '.join(there) or 'none'}.{did_you_mean(name, there)} Your own "
                f"must be installed first, see docs/own.md",
            )
    for name, table in scenario.settings.items():
        key = f"settings.{one_line(name)}"
        if present(name) in BUILT_IN["estimator"] and name != scenario.motion.own:
            yield (
                key,
                f"these tables are for estimators and motions of your own; settings of '{name}' go under "
                f"[{present(name)}]",
            )
        if not (is_available("estimator", name) or is_available("motion", name)):
            there = [*available("estimator"), *available("motion")]
            hint = did_you_mean(name, there)
            yield key, f"there is no such estimator or motion.{hint} There are: {', '.join(there)}"
        for place, value in leaves(table, f"settings.{name}"):
            if not isinstance(value, bool | float | str) and not (isinstance(value, int) and abs(value) < 2**63):
                yield place, f"expected a number of 64 bits, text, true or false; found {as_toml(value)}"


def unused_settings_complaints(scenario: Scenario) -> Iterator[Complaint]:
    """Complain about settings of what the scenario does not use.

    A run with another estimator than its scenario says may well leave some out.
    """
    motion = scenario.motion.own
    for name in scenario.settings:
        if name not in (*estimator_names(scenario.estimator), motion):
            keys = [f'{key} = "{name}"' for kind, key in _KEYS.items() if is_available(kind, name)]
            own_motion = "no motion of your own" if motion is None else f"the motion '{motion}'"
            yield (
                f"settings.{name}",
                f"found settings of what this scenario does not use: its estimator is '{scenario.estimator}', and it "
                f"names {own_motion}. Leave them out, or add {' or '.join(keys)}",
            )


def leaves(value: object, place: str = "") -> Iterator[tuple[str, object]]:
    """All values in nested builtins, with their keys."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from leaves(inner, f"{place}.{key}".lstrip("."))
    elif isinstance(value, list | tuple):
        for index, inner in enumerate(value):
            yield from leaves(inner, f"{place}[{index}]")
    else:
        yield place, value

"""What must hold for estimators and motions, and for the settings of your own ones."""

from __future__ import annotations

from collections.abc import Iterator

from coheft.errors import ScenarioError, one_line
from coheft.wire.former_names import present
from coheft.wire.scenario.errors import did_you_mean
from coheft.wire.scenario.plugins import SECTIONS, Kind, available, estimator_names, is_available
from coheft.wire.scenario.schema import Scenario
from coheft.wire.scenario.toml_value import as_toml

_KEYS: dict[Kind, str] = {"estimator": "estimator", "motion": "motion.own"}
"""Where a scenario names which it uses."""


def check_plugins(scenario: Scenario, origin: str) -> None:
    """Check that estimator and motion are there, and that settings are of something that is.

    Raises:
        ScenarioError: One is not.
    """
    estimators = estimator_names(scenario.estimator)
    _check_different(estimators, origin)
    chosen: list[tuple[Kind, str | None]] = [("motion", scenario.motion.own)]
    chosen += [("estimator", name) for name in estimators]
    for kind, name in chosen:
        if name is not None and not is_available(kind, name):
            key, there = _KEYS[kind], available(kind)
            raise ScenarioError(
                f"{origin}: key '{key}': found {name!r}, expected one of: {', '.join(there) or 'none'}."
                f"{did_you_mean(name, there)} Your own must be installed first, see docs/own.md"
            )
    for name, table in scenario.settings.items():
        if present(name) in SECTIONS and name != scenario.motion.own:
            raise ScenarioError(
                f"{origin}: key 'settings.{name}': these tables are for estimators and motions of your own; settings "
                f"of '{name}' go under [{SECTIONS[present(name)]}]"
            )
        if not (is_available("estimator", name) or is_available("motion", name)):
            there = [*available("estimator"), *available("motion")]
            raise ScenarioError(
                f"{origin}: key 'settings.{one_line(name)}': there is no such estimator or motion."
                f"{did_you_mean(name, there)} There are: {', '.join(there)}"
            )
        for place, value in leaves(table, f"settings.{name}"):
            if not isinstance(value, bool | float | str) and not (isinstance(value, int) and abs(value) < 2**63):
                raise ScenarioError(
                    f"{origin}: key '{place}': expected a number of 64 bits, text, true or false; found "
                    f"{as_toml(value)}"
                )


def _check_different(estimators: list[str], origin: str) -> None:
    twice = [name for name in dict.fromkeys(estimators) if estimators.count(name) > 1]
    if twice:
        raise ScenarioError(
            f"{origin}: key 'estimator': found '{twice[0]}' twice, expected different estimators side by side"
        )


def check_settings_used(scenario: Scenario, origin: str) -> None:
    """Check that no settings are of what the scenario does not use.

    A run with another estimator than its scenario says may well leave some out.

    Raises:
        ScenarioError: Some are.
    """
    motion = scenario.motion.own
    for name in scenario.settings:
        if name not in (*estimator_names(scenario.estimator), motion):
            keys = [f'{key} = "{name}"' for kind, key in _KEYS.items() if is_available(kind, name)]
            own_motion = "no motion of your own" if motion is None else f"the motion '{motion}'"
            raise ScenarioError(
                f"{origin}: key 'settings.{name}': found settings of what this scenario does not use: its estimator is "
                f"'{scenario.estimator}', and it names {own_motion}. Leave them out, or add {' or '.join(keys)}"
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

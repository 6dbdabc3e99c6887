"""Changes of a scenario by options of the command line."""

import re
from collections.abc import Sequence

import msgspec

from coheft.errors import ScenarioError
from coheft.wire.scenario.change_checks import late_change_complaints
from coheft.wire.scenario.checks import check_scenario
from coheft.wire.scenario.errors import explain
from coheft.wire.scenario.rules import check
from coheft.wire.scenario.schema import LoadChange, Scenario

_ORIGIN = "command line"
_OPTIONS = {"duration": "duration", "seed": "seed", "estimator": "estimator", "sensors.rate": "sensor-rate"}
"""Options, by the keys of a scenario that they change."""
_CHANGE_KEYS = {"t": "at", "mass": "mass", "at": "position", "size": "size", "leak": "leak", "remove": "remove"}
_KEYS_OF_CHANGES = {theirs: ours for ours, theirs in _CHANGE_KEYS.items()}
_CHANGE_EXAMPLE = "--change t=20,mass=3,at=0.4,0.3,0.1"


def override(
    scenario: Scenario,
    *,
    changes: Sequence[str] = (),
    duration: float | None = None,
    seed: int | None = None,
    estimator: str | None = None,
    sensor_rate: int | None = None,
    feedforward: bool | None = None,
    origin: str = _ORIGIN,
) -> Scenario:
    """Return the scenario with the given values in place of its own; ``changes`` replace all load changes.

    ``origin`` names the source of the values in the ``ScenarioError`` that says why the result is not valid.
    """
    table = msgspec.to_builtins(scenario)
    given = {"duration": duration, "seed": seed, "estimator": estimator}
    table.update({key: value for key, value in given.items() if value is not None})
    if sensor_rate is not None:
        table["sensors"]["rate"] = sensor_rate
    if feedforward is not None:
        if scenario.carry is None:
            raise ScenarioError(
                f"{_ORIGIN}: --feedforward and --no-feedforward are for scenarios with a common path, section 'carry'; "
                f"found none in '{scenario.name}': try 'coheft run carry6'"
            )
        table["carry"]["feedforward"] = feedforward
    if changes:
        table["load_changes"] = [msgspec.to_builtins(_parse_change(text)) for text in changes]
    try:
        changed = msgspec.convert(table, Scenario)
        check_scenario(changed, origin)
        if changes:  # a shorter duration may leave out some of the scenario's own changes
            check(changed, origin, late_change_complaints)
    except msgspec.ValidationError as error:
        raise ScenarioError(_by_options(f"{origin}: {explain(error, table)}", changes)) from error
    except ScenarioError as error:
        raise ScenarioError(_by_options(str(error), changes)) from error
    return changed


def _by_options(text: str, changes: Sequence[str]) -> str:
    """Replace the key in an error by the option that changes it."""
    match = re.match(rf"{_ORIGIN}: key '(\w+(?:\.\w+)?)(?:\[(\d+)\](?:\.(\w+))?)?': ", text)
    if match is None:
        return text
    key, index, part = match.groups()
    rest = text[match.end() :]
    if key in _OPTIONS:
        return f"--{_OPTIONS[key]}: {rest}"
    if key != "load_changes" or index is None or not changes:
        return text
    return f"--change {changes[int(index)]}: {f'key {_KEYS_OF_CHANGES[part]!r}: ' if part is not None else ''}{rest}"


def _parse_change(text: str) -> LoadChange:
    """Parse a load change such as ``t=20,mass=3,at=0.4,0.3,0.1``: a part without ``=`` belongs to the key before it."""
    values: dict[str, list[str]] = {}
    key = ""
    for part in text.split(","):
        name, equals, value = part.rpartition("=")
        if equals:
            key = name.strip()
            if key not in _CHANGE_KEYS or key in values:
                raise _change_error(text, f"key '{key}' {'is there twice' if key in values else 'is unknown'}")
            values[key] = []
        if not key:
            raise _change_error(text, f"found '{part}' before any key")
        values[key].append(value.strip())
    change = {_CHANGE_KEYS[key]: found[0] if len(found) == 1 else found for key, found in values.items()}
    try:
        return msgspec.convert(change, LoadChange, strict=False)  # numbers are still texts
    except msgspec.ValidationError as error:
        explained = explain(error, change, LoadChange)
        raise _change_error(
            text, re.sub(r"^key '(\w+)", lambda found: f"key '{_KEYS_OF_CHANGES[found[1]]}", explained)
        ) from error


def _change_error(text: str, what: str) -> ScenarioError:
    allowed = ", ".join(_CHANGE_KEYS)
    return ScenarioError(f"--change {text}: {what}; allowed keys: {allowed}; for example {_CHANGE_EXAMPLE}")

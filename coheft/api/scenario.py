"""Scenarios in Python: by name, from a file, from dictionaries, or built from classes."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from coheft.errors import ScenarioError
from coheft.wire.former_names import rename_sections
from coheft.wire.scenario.file import parse_table, read_text, scenario_of, scenario_path
from coheft.wire.scenario.schema import Scenario
from coheft.wire.scenario.set_values import put_value

Source = str | Path | Mapping[str, Any] | Scenario
"""Sources of a scenario: a shipped one's name, the path of a TOML file, a dictionary with the same keys, or an object
that was built in Python."""


def load_scenario(source: Source, *, set: Mapping[str, Any] | None = None) -> Scenario:
    """Load or build a scenario, with all checks of a file.

    Args:
        source: Name of a shipped scenario, path of a ``.toml`` file, dictionary with the keys of such a file, or a
            ``Scenario`` that was built in Python. Paths of meshes and models are relative to the file, or else to the
            present folder.
        set: Values by key, applied before the checks: ``{"sensors.rate": 1000, "load_changes[0].at": 8}``.

    Raises:
        ScenarioError: There is no such scenario, or it is invalid; the message says which key, what was found and what
            was expected.
    """
    table, origin, folder = _table_of(source)
    for key, value in (set or {}).items():
        put_value(table, key, value, f"set={{{key!r}: {value!r}}}")
    if set:
        origin += f" with set={dict(set)!r}"
    return scenario_of(table, origin, folder)


def _table_of(source: Source) -> tuple[dict[str, Any], str, Path]:
    """Return nested dictionaries that may be modified, their name in errors, and the folder of relative paths."""
    if isinstance(source, Scenario):
        origin = f"scenario '{source.name}'"
        try:
            return _as_in_files(msgspec.to_builtins(source)), origin, Path()
        except TypeError as error:
            raise ScenarioError(f"{origin}: expected numbers, texts, tuples and sections only: {error}") from error
    if isinstance(source, Mapping):
        table = _as_in_files(source)
        origin = f"scenario {table.get('name', 'without name')!r}"
        rename_sections(table, origin)
        return table, origin, Path()
    path = scenario_path(source)
    return parse_table(read_text(path), str(path)), str(path), path.parent


def _as_in_files(value: Any) -> Any:
    """Copy a value, with dictionaries and lists in place of mappings and tuples."""
    if isinstance(value, Mapping):
        return {key: _as_in_files(each) for key, each in value.items()}
    return [_as_in_files(each) for each in value] if isinstance(value, list | tuple) else value

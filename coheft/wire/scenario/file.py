"""Scenarios from TOML files.

``load_scenario`` takes a path, or the name of a scenario in ``configs/``. What cannot be used raises a
``ScenarioError``, which names the file, the key, what was found there and what is allowed.
"""

import os
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from coheft.errors import ScenarioError
from coheft.wire.former_names import rename_sections
from coheft.wire.scenario.change_checks import late_change_complaints
from coheft.wire.scenario.checks import check_scenario, choice_complaints
from coheft.wire.scenario.errors import did_you_mean, explain
from coheft.wire.scenario.payload_extent import place_complaints
from coheft.wire.scenario.payload_file import read_files
from coheft.wire.scenario.plugin_checks import unused_settings_complaints
from coheft.wire.scenario.rules import check
from coheft.wire.scenario.schema import Scenario
from coheft.wire.scenario.set_values import set_values

CONFIG_FOLDER = (Path(__file__).parents[2] / "configs").resolve()
"""Folder of the shipped scenarios."""


def available_scenarios() -> dict[str, Path]:
    """Return the files of the shipped scenarios, by name."""
    return {path.stem: path for path in sorted(CONFIG_FOLDER.glob("*.toml"))}


def scenario_path(source: str | Path) -> Path:
    """Return the path of a TOML file, or of a shipped scenario by its name; ``ScenarioError`` if there is none."""
    path = Path(source)
    if path.suffix == ".toml":
        return path
    shipped = available_scenarios()
    if str(source) not in shipped:
        raise ScenarioError(_unknown_scenario(str(source), list(shipped)))
    return shipped[str(source)]


def load_scenario(source: str | Path, values: Sequence[str] = ()) -> Scenario:
    """Read a scenario from a TOML file, or a shipped one by its name, with some values changed, see ``set_values``."""
    path = scenario_path(source)
    return parse_scenario(read_text(path), _origin(str(path), values), path.parent, values)


def read_text(path: Path) -> str:
    """Return the text of a scenario's file."""
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise ScenarioError(_no_file(path, error)) from error
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ScenarioError(f"{str(path)!r}: no file can have this name: {error}") from error
    try:
        return data.decode("utf-8-sig")  # Windows puts a byte-order mark first
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{path}: not UTF-8 text: {error}") from error


def parse_scenario(text: str, origin: str, folder: Path = Path(), values: Sequence[str] = ()) -> Scenario:
    """Make a scenario from TOML text, with some values changed, see ``set_values`` and ``scenario_of``."""
    table = parse_table(text, origin)
    set_values(table, values)
    return scenario_of(table, origin, folder)


def parse_table(text: str, origin: str) -> dict[str, Any]:
    """Return nested dictionaries and lists from TOML text, with present names of sections."""
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also raised for too many digits, and for deep nesting
        raise ScenarioError(f"{origin}: not valid TOML: {error}") from error
    rename_sections(table, origin)
    return table


def scenario_of(table: dict[str, Any], origin: str, folder: Path = Path()) -> Scenario:
    """Make a scenario from nested dictionaries and lists, with all checks, and read the files that it names.

    ``origin`` names it in errors; ``folder`` is that of relative paths.
    """
    try:
        scenario = msgspec.convert(table, Scenario)
    except msgspec.ValidationError as error:
        raise ScenarioError(f"{origin}: {explain(error, table)}") from error
    scenario = complete_scenario(scenario, origin, folder)
    check(scenario, origin, late_change_complaints, unused_settings_complaints)
    return scenario


def with_values(scenario: Scenario, values: Sequence[str]) -> Scenario:
    """Return a scenario with some values changed, see ``set_values``, and all checks."""
    table = msgspec.to_builtins(scenario)
    set_values(table, values)
    return scenario_of(table, _origin(scenario.name, values))


def _origin(name: str, values: Sequence[str]) -> str:
    return f"{name} with {' '.join(f'--set {value}' for value in values)}" if values else name


def complete_scenario(scenario: Scenario, origin: str, folder: Path) -> Scenario:
    """Check a scenario, and read the files that it names."""
    check(scenario, origin, choice_complaints, place_complaints)
    scenario = read_files(scenario, origin, folder)
    check_scenario(scenario, origin)
    return scenario


def _unknown_scenario(name: str, shipped: list[str]) -> str:
    if os.path.isfile(f"{name}.toml"):  # Path would raise if the name is too long
        return f"there is no scenario '{name}', but there is a file '{name}.toml': give its whole name, with .toml"
    key = {".xml": "mjcf", ".stl": "mesh", ".obj": "mesh", ".msh": "mesh"}.get(os.path.splitext(name.lower())[1])
    if key is not None:
        return f"'{name}' is a payload, not a scenario: name it in one (docs/own.md): payload.{key} = \"{name}\""
    return (
        f"there is no scenario '{name}'.{did_you_mean(name, shipped)} Shipped scenarios: {', '.join(shipped)}. "
        f"For your own, give the path of a file that ends with .toml"
    )


def _no_file(path: Path, error: OSError) -> str:
    return (
        f"{path}: cannot be read: {error.strerror}; looked for {path.absolute()}."
        f"{did_you_mean(path.stem, list(available_scenarios()))} "
        f"'coheft scenarios' lists the shipped ones, which have names without .toml"
    )

"""Scenarios from TOML files.

``load_scenario`` takes a path, or the name of a scenario in ``configs/``. Every error names the file, the key, what
was found there and what is allowed.
"""

from __future__ import annotations

import difflib
import os
import re
import tomllib
from pathlib import Path
from typing import Literal, get_args, get_origin

import msgspec

from coheft.errors import ScenarioError
from coheft.wire.payload_extent import check_places
from coheft.wire.payload_file import read_files
from coheft.wire.scenario import Scenario
from coheft.wire.scenario_checks import check_changes_come, check_choices, check_scenario

CONFIG_FOLDER = Path(__file__).resolve().parents[2] / "configs"
_SHOWN = 100
"""Characters of a key or a value that an error shows."""


def available_scenarios() -> dict[str, Path]:
    """The shipped scenarios by name."""
    return {path.stem: path for path in sorted(CONFIG_FOLDER.glob("*.toml"))}


def scenario_path(source: str | Path) -> Path:
    """Where a scenario is read from: a TOML file, or a shipped one by its name.

    Raises:
        ScenarioError: There is no such name.
    """
    path = Path(source)
    if path.suffix == ".toml":
        return path
    shipped = available_scenarios()
    if str(source) not in shipped:
        raise ScenarioError(_unknown_scenario(str(source), list(shipped)))
    return shipped[str(source)]


def load_scenario(source: str | Path) -> Scenario:
    """Read a scenario from a TOML file, or a shipped one by its name.

    Raises:
        ScenarioError: There is no such file or name, or its contents cannot be used.
    """
    path = scenario_path(source)
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise ScenarioError(_no_file(path, error)) from error
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ScenarioError(f"{source!r}: no file can have this name: {error}") from error
    try:
        text = data.decode("utf-8-sig")  # Windows puts a byte-order mark first
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{path}: not UTF-8 text: {error}") from error
    return parse_scenario(text, str(path), path.parent)


def parse_scenario(text: str, origin: str, folder: Path = Path()) -> Scenario:
    """Scenario from TOML text.

    Args:
        text: What the file holds.
        origin: Names it in errors.
        folder: What the paths in it are relative to.

    Raises:
        ScenarioError: It is not TOML, or not a scenario, or a file that it names cannot be used.
    """
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also for a number of too many digits, and for deep nesting
        raise ScenarioError(f"{origin}: not valid TOML: {error}") from error
    try:
        scenario = msgspec.convert(table, Scenario)
    except msgspec.ValidationError as error:
        raise ScenarioError(f"{origin}: {explain(error, table)}") from error
    check_choices(scenario, origin)
    check_places(scenario, origin)
    scenario = read_files(scenario, origin, folder)
    check_scenario(scenario, origin)
    check_changes_come(scenario, origin)
    return scenario


def _unknown_scenario(name: str, shipped: list[str]) -> str:
    if os.path.isfile(f"{name}.toml"):  # Path would raise if the name is too long
        return f"there is no scenario '{name}', but there is a file '{name}.toml': give its whole name, with .toml"
    key = {".xml": "mjcf", ".stl": "mesh", ".obj": "mesh", ".msh": "mesh"}.get(os.path.splitext(name.lower())[1])
    if key is not None:
        return f"'{name}' is a payload, not a scenario: name it in one (docs/own.md): payload.{key} = \"{name}\""
    return (
        f"there is no scenario '{name}'.{_did_you_mean(name, shipped)} Shipped scenarios: {', '.join(shipped)}. "
        f"For your own, give the path of a file that ends with .toml"
    )


def _no_file(path: Path, error: OSError) -> str:
    return (
        f"{path}: cannot be read: {error.strerror}; looked for {path.absolute()}."
        f"{_did_you_mean(path.stem, list(available_scenarios()))} "
        f"'coheft scenarios' lists the shipped ones, which have names without .toml"
    )


def _did_you_mean(found: str, available: list[str]) -> str:
    """A hint, with a space before it, or nothing."""
    close = difflib.get_close_matches(found, available, n=1)
    return f" Did you mean '{close[0]}'?" if close else ""


def explain(error: msgspec.ValidationError, table: dict[str, object]) -> str:
    """Name the key of the scenario and what was found there, beside what msgspec says was expected."""
    message = str(error)
    match = re.search(r" - at `\$(.*)`$", message, re.DOTALL)
    place = match.group(1).lstrip(".") if match else ""
    text = message[: match.start()] if match else message
    unknown = re.search(r"unknown field `(.*)`", text, re.DOTALL)
    if unknown is not None:
        place = f"{place}.{unknown.group(1)}".lstrip(".")
        allowed = _allowed_keys(place)
        hint = _did_you_mean(unknown.group(1), allowed)
        return f"key '{_short(place)}': there is no such key.{hint} Allowed here: {', '.join(allowed)}"
    missing = re.search(r"missing required field `(.*)`", text)
    if missing is not None:
        place = f"{place}.{missing.group(1)}".lstrip(".")
        return f"key '{place}': it is missing, but required"
    found = _value_at(table, place)
    if text.startswith("Invalid enum value"):
        text = f"expected one of {', '.join(_allowed_values(place))}"
    if place.startswith("robots.sites["):
        text = "expected names of sites of the model, as text; places go under 'robots.grasps'"
    return f"key '{place or '(top)'}': {text[0].lower()}{text[1:]}; found {_shown(found)}"


def _shown(value: object) -> str:
    """The value for an error."""
    try:
        text = repr(value)
    except ValueError:  # Python writes no decimal numbers of more than 4300 digits
        return "a number of thousands of digits"
    return _short(text)


def _short(text: str) -> str:
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


def _value_at(table: object, place: str) -> object:
    value = table
    for part in re.findall(r"[^.\[\]]+", place):
        try:
            value = value[int(part)] if isinstance(value, list) else value[part]  # type: ignore[index]
        except (KeyError, IndexError, TypeError, ValueError):
            return None
    return value


def _allowed_keys(place: str) -> list[str]:
    """Keys of the section that holds ``place``."""
    return [field.encode_name for field in msgspec.structs.fields(_section_of(place))]


def _allowed_values(place: str) -> list[str]:
    """Values of the ``Literal`` at ``place``, and "a number" if that is an alternative."""
    key = place.rpartition(".")[2]
    field = next(f for f in msgspec.structs.fields(_section_of(place)) if f.encode_name == key)
    if get_origin(field.type) is Literal:
        return [repr(value) for value in get_args(field.type)]
    alternatives = get_args(field.type)
    values = [repr(value) for literal in alternatives if get_origin(literal) is Literal for value in get_args(literal)]
    return [*values, "a number"]


def _section_of(place: str) -> type[msgspec.Struct]:
    """The section that holds the key at ``place``."""
    section: type[msgspec.Struct] = Scenario
    for part in re.findall(r"[^.\[\]]+", place)[:-1]:
        field = next((f for f in msgspec.structs.fields(section) if f.encode_name == part), None)
        inner = _struct_in(field.type) if field is not None else None
        section = inner or section
    return section


def _struct_in(annotation: object) -> type[msgspec.Struct] | None:
    """The struct type inside ``Annotated``, ``tuple`` or ``| None``."""
    if isinstance(annotation, type) and issubclass(annotation, msgspec.Struct):
        return annotation
    for inner in getattr(annotation, "__args__", ()):
        found = _struct_in(inner)
        if found is not None:
            return found
    return None

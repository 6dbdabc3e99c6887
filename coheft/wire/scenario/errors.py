"""Error messages about the keys and values of a scenario."""

import difflib
import re
from collections.abc import Mapping

import msgspec
from msgspec import inspect as types

from coheft.wire.former_names import GONE
from coheft.wire.scenario.expected import expected_by_msgspec
from coheft.wire.scenario.schema import Scenario
from coheft.wire.scenario.section import NAME_IN_WORDS
from coheft.wire.scenario.toml_value import as_toml

_RENAMED = {
    "efficient.offsets": "robots know one standard deviation of each sensor error; 'offsets = true' is the same as "
    "sensors.tolerance = { force_offset = 1.2, torque_offset = 0.06 }",
    "sensors.offset": "errors are drawn with standard deviations; a largest one of 2 N is about the same as "
    "sensors.errors = { force_offset = 1.2 }",
}
"""Keys of earlier releases, with their replacements."""
_SHOWN = 100  # characters of a key or a value


def explain(
    error: msgspec.ValidationError, table: Mapping[str, object], section: type[msgspec.Struct] = Scenario
) -> str:
    """Return a message with the key, the value that was found and what was expected."""
    message = str(error)
    match = re.search(r" - at `\$(.*)`$", message, re.DOTALL)
    place = match.group(1).lstrip(".").replace("[...]", "") if match else ""  # [...] is any key of a table
    text = message[: match.start()] if match else message
    unknown = re.search(r"unknown field `(.*)`", text, re.DOTALL)
    if unknown is not None:
        kind = _parted(_type_at(section, place))
        allowed = [field.encode_name for field in kind.fields] if isinstance(kind, types.StructType) else []
        hint = did_you_mean(unknown.group(1), allowed)
        key = _short(f"{place}.{unknown.group(1)}".lstrip("."))
        if key in GONE:
            return f"key '{key}': it is of a former release and has no successor: {GONE[key]}. Delete the line"
        if key in _RENAMED:
            return f"key '{key}': it is of a former release; now {_RENAMED[key]}"
        return f"key '{key}': there is no such key.{hint} Allowed here: {', '.join(allowed)}"
    missing = re.search(r"missing required field `(.*)`", text)
    if missing is not None:
        place = f"{place}.{missing.group(1)}".lstrip(".")
        return f"key '{place}': it is missing, but required"
    expected = _expected(text, place, _type_at(section, place))
    return f"key '{place or '(top)'}': {expected}; found {_shown(_value_at(table, place))}"


def did_you_mean(found: str, available: list[str]) -> str:
    """Return a hint with a leading space, or an empty text."""
    close = difflib.get_close_matches(found, available, n=1)
    return f" Did you mean '{close[0]}'?" if close else ""


def _expected(text: str, place: str, kind: types.Type | None) -> str:
    """Describe the values allowed for a kind about which msgspec complains with ``text``."""
    key = re.sub(r"\[[^]]*\]$", "", place)
    if place.startswith("robots.sites["):
        return "expected names of sites of the model, as text; places go under 'robots.grasps'"
    match kind:
        case types.LiteralType(values=values):
            return f"expected one of {', '.join(map(as_toml, values))}"
        case types.UnionType(types=alternatives) if text.startswith("Invalid enum value") or kind != _parted(kind):
            words = [word for each in alternatives if isinstance(each, types.LiteralType) for word in each.values]
            is_section = any(isinstance(each, types.StructType) for each in alternatives)
            is_list = any(isinstance(each, types.VarTupleType) for each in alternatives)
            other = f"a section, written [{key}]" if is_section else "or a list of several" if is_list else "a number"
            return f"expected one of {', '.join(map(as_toml, words))}, {other}"
        case types.StrType(pattern=str()):
            return f"expected {NAME_IN_WORDS}"
        case types.TupleType(item_types=items):
            return f"expected {len(items)} numbers"
        case types.VarTupleType(item_type=types.StructType()):
            return f"expected sections, each written [[{key}]]"
        case types.VarTupleType():
            return "expected a list of texts"
        case types.StructType():
            return f"expected a section, written {f'[{key}]' if key == place else f'[[{key}]]'}"
        case types.DictType(value_type=types.StrType()):
            return "expected a text under each name"
        case types.DictType():
            return f"expected tables, each written [{key}.NAME]"
    return expected_by_msgspec(text)


def _type_at(section: type[msgspec.Struct], place: str) -> types.Type | None:
    """Return the type of a key of a section; None if there is no such key."""
    kind: types.Type = types.type_info(section)
    for part in re.findall(r"[^.\[\]]+", place):
        match _parted(_without_null(kind)):
            case types.StructType(fields=fields):
                found = [field.type for field in fields if field.encode_name == part]
                if not found:
                    return None
                kind = found[0]
            case types.VarTupleType(item_type=item):
                kind = item
            case types.TupleType(item_types=items):
                kind = items[int(part)]
    return _without_null(kind)


def _parted(kind: types.Type | None) -> types.Type | None:
    """Return the type that has fields, among several types."""
    if not isinstance(kind, types.UnionType):
        return kind
    return next((each for each in kind.types if isinstance(each, types.StructType)), kind)


def _without_null(kind: types.Type) -> types.Type:
    if not isinstance(kind, types.UnionType):
        return kind
    others = tuple(each for each in kind.types if not isinstance(each, types.NoneType))
    return others[0] if len(others) == 1 else types.UnionType(others)


def _shown(value: object) -> str:
    try:
        return _short(as_toml(value))
    except ValueError:  # Python does not print integers of more than 4300 digits
        return "a number of thousands of digits"


def _short(text: str) -> str:
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


def _value_at(table: object, place: str) -> object:
    value = table
    for part in re.findall(r"[^.\[\]]+", place):
        try:
            value = value[int(part)] if isinstance(value, list | tuple) else value[part]  # type: ignore[index]
        except (KeyError, IndexError, TypeError, ValueError):
            return None
    return value

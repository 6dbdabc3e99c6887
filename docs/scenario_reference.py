"""Writes the reference of all keys of a scenario in docs/scenarios.md, from the scenario's own types and docstrings.

Run it after a change of ``coheft/wire/scenario/schema.py``; a test fails otherwise.
"""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
from msgspec import inspect as types

from coheft.wire.scenario.json_schema import meanings, summary
from coheft.wire.scenario.schema import Scenario
from coheft.wire.scenario.section import NAME_IN_WORDS

PAGE = Path(__file__).with_name("scenarios.md")

_MARK = "<!-- All that follows is written by docs/scenario_reference.py -->\n"


def page() -> str:
    """Return the page in Markdown: the part by hand up to the mark, and then the reference."""
    by_hand, mark, _ = PAGE.read_text().partition(_MARK)
    first: dict[type[msgspec.Struct], str] = {}
    parts = [by_hand + mark]
    for place, section in _sections("", Scenario):
        if first.setdefault(section, place) == place:
            parts.append(_section(place, section))
        else:
            parts.append(f"## `{place}`\n\nThe keys are those of {_link(first[section])}.\n")
    return "\n".join(parts)


def _link(place: str) -> str:
    """Return a link to a section of the page; anchors are made as GitHub and MyST make them."""
    return f"[`{place}`](#{place.strip('[]').replace('.', '')})"


def _sections(place: str, section: type[msgspec.Struct]) -> Iterator[tuple[str, type[msgspec.Struct]]]:
    """Yield a section and all sections in it, with their TOML headers."""
    yield place, section
    for field in msgspec.structs.fields(section):
        kind, brackets = _inner(types.type_info(field.type))
        if isinstance(kind, types.StructType):
            name = f"{place.strip('[]')}.{field.encode_name}".lstrip(".")
            yield from _sections(f"[[{name}]]" if brackets else f"[{name}]", kind.cls)


def _inner(kind: types.Type) -> tuple[types.Type, bool]:
    """Return the type without "or none", or the type of a list's items, and whether it is a list."""
    if isinstance(kind, types.UnionType):
        inner = [each for each in kind.types if not isinstance(each, types.NoneType)]
        kind = next((each for each in inner if isinstance(each, types.StructType)), inner[0])
    return (kind.item_type, True) if isinstance(kind, types.VarTupleType) else (kind, False)


def _section(place: str, section: type[msgspec.Struct]) -> str:
    meaning_of = meanings(section)
    lines = [f"## {f'`{place}`' if place else 'Top level'}", "", _markdown(summary(section)), ""]
    lines += ["| key | value | unit | default | meaning |", "|---|---|---|---|---|"]
    for field in msgspec.structs.fields(section):
        meaning = meaning_of[field.encode_name]
        units = ", ".join(re.findall(r"\[([^]]+)\]", meaning))
        cells = (
            f"`{field.encode_name}`",
            _value(types.type_info(field.type)),
            units,
            _default(field),
            _markdown(re.sub(r" \[[^]]+\]", "", meaning)),
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join([*lines, ""])


def _markdown(text: str) -> str:
    return " ".join(text.replace("``", "`").split())


def _value(kind: types.Type) -> str:
    """Describe the allowed values."""
    match kind:
        case types.FloatType():
            return f"number{_range(kind)}"
        case types.IntType():
            return f"whole number{_range(kind)}"
        case types.BoolType():
            return "`true` or `false`"
        case types.StrType(pattern=str()):
            return NAME_IN_WORDS
        case types.StrType():
            return "text"
        case types.LiteralType():
            return ", ".join(f"`{json.dumps(value)}`" for value in kind.values)
        case types.TupleType():
            ranges = [_range(item) for item in kind.item_types]
            if len(set(ranges)) == 1:
                return f"{len(ranges)} numbers{ranges[0]}"
            return f"{len(ranges)} numbers: {', '.join(each.strip() or 'any' for each in ranges)}"
        case types.VarTupleType(item_type=types.StructType()):
            return "sections"
        case types.VarTupleType():
            return f"list of {_value(kind.item_type)}s"
        case types.DictType():
            return "tables"
        case types.StructType():
            return "section"
        case types.UnionType():
            several = [each for each in kind.types if not isinstance(each, types.NoneType)]
            lists = [each for each in several if isinstance(each, types.VarTupleType) and each.item_type in several]
            ways = [_value(each) for each in several if each not in lists]
            return " or ".join([*ways, *("list of several" for _ in lists)])
    raise NotImplementedError(kind)


def _range(kind: Any) -> str:
    low = f"> {kind.gt:g}" if kind.gt is not None else f"≥ {kind.ge}" if kind.ge is not None else ""
    high = f"< {kind.lt}" if kind.lt is not None else f"≤ {kind.le:g}" if kind.le is not None else ""
    return f" {low}{', ' * bool(low and high)}{high}".rstrip()


def _default(field: msgspec.structs.FieldInfo) -> str:
    if field.required:
        return "**required**"
    default = msgspec.to_builtins(field.default) if field.default is not msgspec.NODEFAULT else {}
    if default is None or default in ("", []) or isinstance(default, dict):
        return ""
    return f"`{json.dumps(default)}`"


if __name__ == "__main__":
    PAGE.write_text(page())

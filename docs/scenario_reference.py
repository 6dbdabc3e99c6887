"""Writes docs/scenarios.md, the reference of all keys of a scenario, from the scenario's own types and docstrings.

To be run again after a change of ``coheft/wire/scenario/schema.py``; a test tells when that was forgotten.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
from msgspec import inspect as types

from coheft.wire.scenario.meanings import meanings, summary
from coheft.wire.scenario.schema import Scenario
from coheft.wire.scenario.section import NAME_IN_WORDS

PAGE = Path(__file__).with_name("scenarios.md")

_INTRODUCTION = """# Scenarios

A scenario is a TOML file that describes a payload, robots, their links and sensors, and changes of the load. `coheft
run my.toml` runs it; `coheft scenarios` lists the shipped ones, in the folder `configs`. This example has two robots,
and a load that is dropped after five seconds:

```toml
name = "two"
duration = 12.0
payload.boxes = [{ mass = 6.0, size = [0.8, 0.3, 0.1] }]
robots.grasps = [{ position = [-0.4, 0.0, 0.0] }, { position = [0.4, 0.0, 0.0], rotation_deg = [0, 0, 180] }]
graph.kind = "line"

[[load_changes]]
at = 5.0
mass = 1.0
position = [0.1, 0.0, 0.1]
```

Rotations are rotation vectors. Keys that are not required can be left out. Unknown keys and values out of range are
errors, which name the key, what was found, and what is allowed.

Single values can be changed on the command line:
`coheft run ring3 --set sensors.noise_scale=2 --set load_changes[0].at=8`.

This page is generated from the code by `python docs/scenario_reference.py`.
"""


def page() -> str:
    """The whole page, in Markdown."""
    return "\n".join([_INTRODUCTION, *(_section(place, section) for place, section in _sections("", Scenario))])


def _sections(place: str, section: type[msgspec.Struct]) -> Iterator[tuple[str, type[msgspec.Struct]]]:
    """A section and all within it, with the TOML header of each."""
    yield place, section
    for field in msgspec.structs.fields(section):
        kind, brackets = _inner(types.type_info(field.type))
        if isinstance(kind, types.StructType):
            name = f"{place.strip('[]')}.{field.encode_name}".lstrip(".")
            yield from _sections(f"[[{name}]]" if brackets else f"[{name}]", kind.cls)


def _inner(kind: types.Type) -> tuple[types.Type, bool]:
    """The type without "or none", and what it is a list of; and whether it is a list."""
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
    """What may stand there, in words."""
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
            return " or ".join(_value(inner) for inner in kind.types if not isinstance(inner, types.NoneType))
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

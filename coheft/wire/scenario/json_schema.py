"""Descriptions of a scenario's keys, and its JSON schema, with which editors complete, explain and check scenarios."""

import inspect
import re
from collections.abc import Iterator
from typing import Any

import msgspec
from msgspec import inspect as types

from coheft.wire.scenario.schema import Scenario

_DIALECT = "https://json-schema.org/draft/2020-12/schema"


def scenario_schema() -> dict[str, Any]:
    """Return the schema: keys, kinds of values and their ranges. Conditions between keys are checked by coheft only."""
    schema = msgspec.json.schema(Scenario)
    for section in set(_sections(types.type_info(Scenario))):
        found = schema["$defs"][section.__name__]
        found["description"] = summary(section)
        for key, meaning in meanings(section).items():
            found["properties"][key]["description"] = meaning.replace("``", "`")
        for value in found["properties"].values():
            if "pattern" in value:  # JSON schemas use regular expressions of JavaScript
                value["pattern"] = value["pattern"].replace(r"\Z", "$")
    return {"$schema": _DIALECT, "title": "A scenario of coheft", **schema}


def _sections(kind: types.Type) -> Iterator[type[msgspec.Struct]]:
    """A kind of value, if it is a section, and all sections within it."""
    match kind:
        case types.StructType(cls=cls, fields=fields):
            yield cls
            for field in fields:
                yield from _sections(field.type)
        case types.UnionType(types=alternatives):
            for each in alternatives:
                yield from _sections(each)
        case types.VarTupleType(item_type=item):
            yield from _sections(item)


def summary(section: type[msgspec.Struct]) -> str:
    """Return the description of a section."""
    return " ".join(inspect.cleandoc(section.__doc__ or "").partition("Attributes:")[0].split())


def meanings(section: type[msgspec.Struct]) -> dict[str, str]:
    """Return the descriptions of a section's keys, by name; units are in brackets."""
    attributes = inspect.cleandoc(section.__doc__ or "").partition("Attributes:")[2]
    entries = re.findall(r"^ {4}(\w+): (.*(?:\n {8}.*)*)", attributes, re.MULTILINE)
    return {name: " ".join(meaning.split()) for name, meaning in entries}

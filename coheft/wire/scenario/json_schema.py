"""Descriptions of a scenario's keys, and its JSON schema, with which editors complete, explain and check scenarios."""

import inspect
import re
from typing import Any

import msgspec

from coheft.estimation.measurement import SensorNoise
from coheft.estimation.tolerance import SensorDrift, SensorTolerance
from coheft.wire.scenario.schema import Scenario
from coheft.wire.scenario.section import Section

_DIALECT = "https://json-schema.org/draft/2020-12/schema"


def scenario_schema() -> dict[str, Any]:
    """Return the schema: keys, kinds of values and their ranges. Conditions between keys are checked by coheft only."""
    schema = msgspec.json.schema(Scenario)
    kinds: list[type[msgspec.Struct]] = [*Section.__subclasses__(), SensorNoise, SensorTolerance, SensorDrift]
    sections = {kind.__name__: kind for kind in kinds}
    for name, found in schema["$defs"].items():
        section = sections[name]
        found["description"] = summary(section)
        for key, meaning in meanings(section).items():
            found["properties"][key]["description"] = meaning.replace("``", "`")
        for value in found["properties"].values():
            if "pattern" in value:  # JSON schemas use regular expressions of JavaScript
                value["pattern"] = value["pattern"].replace(r"\Z", "$")
    return {"$schema": _DIALECT, "title": "A scenario of coheft", **schema}


def summary(section: type[msgspec.Struct]) -> str:
    """Return the description of a section."""
    return " ".join(inspect.cleandoc(section.__doc__ or "").partition("Attributes:")[0].split())


def meanings(section: type[msgspec.Struct]) -> dict[str, str]:
    """Return the descriptions of a section's keys, by name; units are in brackets."""
    attributes = inspect.cleandoc(section.__doc__ or "").partition("Attributes:")[2]
    entries = re.findall(r"^ {4}(\w+): (.*(?:\n {8}.*)*)", attributes, re.MULTILINE)
    return {name: " ".join(meaning.split()) for name, meaning in entries}

"""Descriptions of the keys of a scenario, from the docstrings of its sections, for the reference and for editors."""

from __future__ import annotations

import inspect
import re

import msgspec


def summary(section: type[msgspec.Struct]) -> str:
    """Return the description of a section."""
    return " ".join(inspect.cleandoc(section.__doc__ or "").partition("Attributes:")[0].split())


def meanings(section: type[msgspec.Struct]) -> dict[str, str]:
    """Return the descriptions of a section's keys, by name; units are in brackets."""
    attributes = inspect.cleandoc(section.__doc__ or "").partition("Attributes:")[2]
    entries = re.findall(r"^ {4}(\w+): (.*(?:\n {8}.*)*)", attributes, re.MULTILINE)
    return {name: " ".join(meaning.split()) for name, meaning in entries}

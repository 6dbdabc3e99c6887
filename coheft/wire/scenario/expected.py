"""Descriptions of expected values: replaces the names of types and signs of msgspec and cyclopts."""

import re

KINDS = {
    "float": "a number",
    "int": "a whole number",
    "str": "text",
    "bool": "true or false",
    "array": "a list",
    "object": "a section",
}
"""Descriptions of types, by their names in Python or msgspec."""
_SIGNS = {">": "greater than", ">=": "of at least", "<": "less than", "<=": "of at most"}


def expected_number(kind: str, sign: str, limit: str) -> str:
    """Return a description, for instance: expected a whole number of at least 2."""
    return f"expected {KINDS[kind]} {_SIGNS[sign]} {limit.removesuffix('.0')}"


def expected_by_msgspec(text: str) -> str:
    """Rephrase a message of msgspec, without the place; messages not about a type or a range are returned unchanged."""
    match = re.match(r"Expected `(\w+)(?: \| \w+)*`(?: (>=|<=|>|<) (\S+))?", text)
    if match is None:
        return f"{text[0].lower()}{text[1:]}"
    kind, sign, limit = match.groups()
    return expected_number(kind, sign, limit) if sign is not None else f"expected {KINDS.get(kind, kind)}"

"""What was expected in place of what was found, in plain words: msgspec and cyclopts name types and signs."""

from __future__ import annotations

import re

KINDS = {
    "float": "a number",
    "int": "a whole number",
    "str": "text",
    "bool": "true or false",
    "array": "a list",
    "object": "a section",
}
"""By the names that Python has for them, or msgspec."""
_SIGNS = {">": "greater than", ">=": "of at least", "<": "less than", "<=": "of at most"}


def expected_number(kind: str, sign: str, limit: str) -> str:
    """For instance: expected a whole number of at least 2.

    Args:
        kind: ``int`` or ``float``.
        sign: Of the comparison with the limit.
        limit: As text.
    """
    return f"expected {KINDS[kind]} {_SIGNS[sign]} {limit.removesuffix('.0')}"


def expected_by_msgspec(text: str) -> str:
    """A complaint of msgspec, without the place; one that is not about a type or a range stays as it is."""
    match = re.match(r"Expected `(\w+)(?: \| \w+)*`(?: (>=|<=|>|<) (\S+))?", text)
    if match is None:
        return f"{text[0].lower()}{text[1:]}"
    kind, sign, limit = match.groups()
    return expected_number(kind, sign, limit) if sign is not None else f"expected {KINDS.get(kind, kind)}"

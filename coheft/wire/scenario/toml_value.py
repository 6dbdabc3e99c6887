"""Formatting of values in TOML syntax."""

import json
import re
from datetime import date, time


def as_toml(value: object) -> str:
    """Format a value that was read from TOML in one line; None, which TOML does not have, is ``nothing``.

    A number of more than 4300 digits, which Python does not print, is a ``ValueError``.
    """
    match value:
        case None:
            return "nothing"
        case bool():
            return str(value).lower()
        case str():
            return _quoted(value)
        case date() | time():
            return value.isoformat().replace("+00:00", "Z")
        case list() | tuple():
            return f"[{', '.join(map(as_toml, value))}]"
        case dict():
            return f"{{ {', '.join(map(_pair, value.items()))} }}" if value else "{}"
    return repr(value)


def _pair(item: tuple[str, object]) -> str:
    key, value = item
    return f"{key if re.fullmatch(r'[A-Za-z0-9_-]+', key) else _quoted(key)} = {as_toml(value)}"


def _quoted(text: str) -> str:
    """Return a text in quotes, with escapes for unprintable characters."""
    quoted = json.dumps(text, ensure_ascii=False)
    return "".join(char if char.isprintable() else f"\\U{ord(char):08x}" for char in quoted)

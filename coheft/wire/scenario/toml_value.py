"""Values as they are written in TOML."""

from __future__ import annotations

import json
import re
from datetime import date, time


def as_toml(value: object) -> str:
    """A value that was read from TOML as its file may have it, in one line; None, which no file has: ``nothing``.

    Raises:
        ValueError: A number has more than 4300 digits: Python does not write it in decimals.
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
    """Text between quotes, what cannot be printed as escapes."""
    quoted = json.dumps(text, ensure_ascii=False)
    return "".join(char if char.isprintable() else f"\\U{ord(char):08x}" for char in quoted)

"""Values of a scenario that are given as texts, ``KEY=VALUE``: ``sensors.noise_scale=3``, ``load_changes[0].at=8``."""

import re
import tomllib
from collections.abc import Sequence
from typing import Any

from coheft.errors import ScenarioError
from coheft.wire.former_names import SECTIONS
from coheft.wire.scenario.toml_value import as_toml

_KEY = re.compile(r"[A-Za-z0-9_-]+(\.[A-Za-z0-9_-]+|\[\d{1,9}\])*", re.ASCII)
_BARE = re.compile(r"[A-Za-z][\w./-]*")
"""Text that needs no quotes."""


def set_values(table: dict[str, Any], texts: Sequence[str]) -> None:
    """Put values into a scenario's table, nested dictionaries and lists, in place; they are checked later.

    ``texts`` have a key, an equals sign, and a value in TOML syntax; names need no quotes. Another form is a
    ``ScenarioError``, as is a key that leads into a value without parts.
    """
    for text in texts:
        key, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not _KEY.fullmatch(key):
            raise ScenarioError(f"--set {text}: expected KEY=VALUE, for example --set sensors.noise_scale=3")
        put_value(table, key, _parsed(value, text), f"--set {text}")


def varied_values(text: str) -> list[str]:
    """Return texts for ``set_values``, one for each value of ``KEY=a,b,c``; commas in brackets or quotes do not
    separate. No key, or less than two different values, is a ``ScenarioError``.
    """
    key, _, rest = (part.strip() for part in text.partition("="))
    values = [value.strip() for value in _parts(rest)]
    if not _KEY.fullmatch(key) or len(set(values)) < max(2, len(values)) or not all(values):
        raise ScenarioError(
            f"--vary {text}: expected a key and different values, for example --vary sensors.noise_scale=1,2,4"
        )
    return [f"{key}={value}" for value in values]


def _parts(text: str) -> list[str]:
    """Split a text at commas outside of brackets, braces and quotes."""
    parts, depth, quote = [""], 0, ""
    for char in text:
        if quote:
            quote = "" if char == quote else quote
        elif char in "\"'":
            quote = char
        else:
            depth += (char in "[{") - (char in "]}")
        if char == "," and not quote and depth == 0:
            parts.append("")
        else:
            parts[-1] += char
    return parts


def _parsed(value: str, text: str) -> object:
    if value not in ("true", "false", "inf", "nan") and _BARE.fullmatch(value):
        return value
    try:
        return tomllib.loads(f"value = {value}")["value"]
    except (ValueError, RecursionError) as error:
        raise ScenarioError(
            f"--set {text}: found {value!r}, expected a value as TOML has it: 3, 0.5, true, [1, 2], "
            f"{{ mass = 3.0 }} or text: {error}"
        ) from error


def put_value(table: dict[str, Any], key: str, value: object, where: str) -> None:
    """Put a value into a scenario's table, in place; ``where`` names its source in a ``ScenarioError``."""
    if not _KEY.fullmatch(key):
        raise ScenarioError(f"{where}: found the key {key!r}, expected one such as 'sensors.noise_scale'")
    first, *parts = re.findall(r"\[\d+\]|[^.\[\]]+", key)
    parts = [SECTIONS.get(first, first), *parts]
    *path, last = [int(part[1:-1]) if part[0] == "[" else part for part in parts]
    node: Any = table
    for depth, part in enumerate(path):
        _check(node, part, f"{where}: key '{_joined(path[:depth])}'")
        if isinstance(node, dict) and node.get(part) is None:  # a missing section or list
            node[part] = [] if isinstance([*path, last][depth + 1], int) else {}
        node = node[part]
    _check(node, last, f"{where}: key '{_joined(path)}'")
    node[last] = value


def _check(node: Any, part: str | int, where: str) -> None:
    if isinstance(node, dict) and isinstance(part, str):
        return
    if not isinstance(node, list | dict):
        raise ScenarioError(f"{where}: found {as_toml(node)}, which has no parts")
    if isinstance(node, dict):
        raise ScenarioError(f"{where}: found {part!r} for a part of a section, expected a name")
    if isinstance(part, str):
        raise ScenarioError(f"{where}: found {part!r} for a part of a list, expected a number in brackets, from [0]")
    if not node:
        raise ScenarioError(f"{where}: found number {part} of a list that is not given, expected all of it: [...]")
    if part >= len(node):
        raise ScenarioError(f"{where}: found number {part}, but the list has {len(node)}, counted from 0")


def _joined(path: Sequence[str | int]) -> str:
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path).lstrip(".") or "(top)"

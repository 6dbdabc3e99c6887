"""Values as they are written in TOML."""

from __future__ import annotations

import tomllib

import pytest

from coheft.wire.scenario.toml_value import as_toml


@pytest.mark.parametrize(
    "text",
    [
        "true",
        "-7",
        "0.25",
        "inf",
        "2026-01-01",
        "07:32:00",
        "2026-01-01T07:32:00",
        "2026-01-01T07:32:00Z",
        "2026-01-01T07:32:00.500000-07:00",
        '"text"',
        '"ö \\"quoted\\" \\\\"',
        '["a", ["b"], []]',
        '{ a = 1, "two words" = { b = false }, c = {} }',
    ],
)
def test_a_value_is_written_as_it_was_read(text: str) -> None:
    assert as_toml(tomllib.loads(f"key = {text}")["key"]) == text


def test_what_cannot_be_printed_is_escaped_so_that_it_is_read_again() -> None:
    strange = "bell \a, escape \x1b[31m, delete \x7f, mark \u200e, unassigned \U000e0001"
    text = as_toml(strange)
    assert text.isprintable()
    assert tomllib.loads(f"key = {text}") == {"key": strange}


def test_what_is_not_there_is_nothing() -> None:
    assert as_toml(None) == "nothing"


def test_what_tomllib_can_read_is_written_however_deep() -> None:
    for pair in ("[]", ("{a=", "}")):
        depth = 1
        while True:
            try:
                value = tomllib.loads(f"key = {pair[0] * depth}{'[]' if len(pair[0]) > 1 else ''}{pair[1] * depth}")
            except (RecursionError, tomllib.TOMLDecodeError):
                break
            as_toml(value)
            depth += 1
        assert depth > 10

"""What docs/fan2017.md says of functions and tests."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NAMED = re.findall(r"`([\w/]+\.py)::(\w+)`", (ROOT / "docs" / "fan2017.md").read_text())
"""Files, some of them without the folder that the page names, and what is in them."""


@pytest.mark.parametrize(("file", "name"), NAMED)
def test_every_function_and_test_of_the_table_is_there(file: str, name: str) -> None:
    path = next(p for p in (ROOT / file, ROOT / "coheft/estimation/fan2017" / file) if p.exists())
    assert re.search(rf"^ *(def|class) {name}\b", path.read_text(), re.MULTILINE), f"{name} is not in {path}"


def test_the_table_is_not_empty() -> None:
    assert len(NAMED) > 30

"""What is said of a run that Ctrl-C broke off."""

from __future__ import annotations

from typing import Any

import pytest

from coheft.app.broken_off import BrokenOff
from tests.synthetic_run import HEAVY, truth


@pytest.mark.parametrize(
    ("asked", "expected"),
    [
        ({}, "stopped at 16.0 s"),
        ({"json": None, "record": None}, "stopped at 16.0 s"),
        (
            {"json": "a.json"},
            "stopped at 16.0 s: no report (--json) was written; 'coheft stop' ends a run with it",
        ),
        (
            {"save_data": "a.npz", "json": "-"},
            "stopped at 16.0 s: no report (--json) and no data file (--save-data) were written; 'coheft stop' ends a "
            "run with them",
        ),
        ({"record": "run.mcap"}, "stopped at 16.0 s: run.mcap holds what came until then"),
    ],
)
def test_only_what_was_asked_for_is_named(asked: dict[str, Any], expected: str) -> None:
    broken_off = BrokenOff(asked)
    broken_off.hear(truth(799, HEAVY))
    assert broken_off.sentence() == expected


def test_a_run_that_had_not_begun() -> None:
    expected = "stopped before it began: no page (--report) was written; 'coheft stop' ends a run with it"
    assert BrokenOff({"report": "out", "record": "run.mcap"}).sentence() == expected

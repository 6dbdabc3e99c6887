"""What is said of a run that a signal, or an error, broke off."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from coheft.app.run.broken_off import BrokenOff
from tests.synthetic_run import HEAVY, truth

LOGS = Path("logs")


@pytest.mark.parametrize(
    ("asked", "expected"),
    [
        ({}, "'coheft stop', or Ctrl-C pressed once, ends a run with its report; the logs are in logs"),
        (
            {"json": None, "record": None},
            "'coheft stop', or Ctrl-C pressed once, ends a run with its report; the logs are in logs",
        ),
        (
            {"json": "a.json"},
            "no report (--json) was written; 'coheft stop', or Ctrl-C pressed once, ends a run with it; the logs are "
            "in logs",
        ),
        (
            {"save_data": "a.npz", "json": "-"},
            "no report (--json) and no data file (--save-data) were written; 'coheft stop', or Ctrl-C pressed once, "
            "ends a run with them; the logs are in logs",
        ),
        (
            {"record": "run.mcap"},
            "run.mcap holds what came until then; 'coheft stop', or Ctrl-C pressed once, ends a run with its report; "
            "the logs are in logs",
        ),
    ],
)
def test_only_what_was_asked_for_is_named(asked: dict[str, Any], expected: str) -> None:
    broken_off = BrokenOff(asked, LOGS)
    broken_off.receive(truth(799, HEAVY))
    assert broken_off.sentence() == f"stopped at 16.0 s: {expected}"


def test_a_run_that_had_not_begun() -> None:
    sentence = BrokenOff({"report": "out", "record": "run.mcap"}, LOGS).sentence()
    assert sentence == "stopped before it began: no page (--report) was written; the logs are in logs"


def test_a_run_that_one_ctrl_c_could_not_end() -> None:
    broken_off = BrokenOff({"json": "a.json"}, LOGS)
    broken_off.receive(truth(799, HEAVY))
    reason = "the server does not answer"
    assert broken_off.sentence(reason) == (
        f"stopped at 16.0 s: {reason}; no report (--json) was written; the logs are in logs"
    )


@pytest.mark.parametrize(
    ("asked", "expected"),
    [
        ({}, ""),
        ({"json": "a.json"}, "\nThat was at 16.0 s: no report (--json) was written."),
        (
            {"json": "a.json", "report": "out", "record": "run.mcap"},
            "\nThat was at 16.0 s: run.mcap holds what came until then; no report (--json) and no page (--report) were "
            "written.",
        ),
    ],
)
def test_an_error_is_followed_by_what_is_not_there(asked: dict[str, Any], expected: str) -> None:
    broken_off = BrokenOff(asked, LOGS)
    broken_off.receive(truth(799, HEAVY))
    assert broken_off.after_error() == expected


def test_a_server_that_fails_may_have_written_the_data_file(tmp_path: Path) -> None:
    data = tmp_path / "data.npz"
    broken_off = BrokenOff({"json": "a.json", "save_data": data}, LOGS)
    broken_off.receive(truth(799, HEAVY))
    data.touch()
    expected = f"{data} holds what came until then; no report (--json) was written"
    assert broken_off.after_error() == f"\nThat was at 16.0 s: {expected}."
    before = BrokenOff({"save_data": data}, LOGS)
    assert before.after_error() == "\nThat was before it began: no data file (--save-data) was written."

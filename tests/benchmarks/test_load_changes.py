"""Changes can be measured alone, without the hours in which nothing happens."""

from __future__ import annotations

import sys

import pytest

from benchmarks import load_changes


def test_no_hours_are_no_false_alarms(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["load_changes", "--hours", "0", "--changes", ""])
    load_changes.main()
    assert capsys.readouterr().out == "no change: not measured, for --hours is 0\n"

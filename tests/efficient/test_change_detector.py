"""When another load is looked for."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.agents.efficient.change_detector import ChangeDetector, ChangeTestSchedule
from coheft.agents.efficient.innovations import EvaluatedRow, Innovations
from coheft.agents.efficient.knowledge import Knowledge
from coheft.agents.efficient.session import Session
from coheft.agents.efficient.settings import Guards, RowCounts
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.moments.change import Look, StepThresholds
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.rows import RowNoise
from tests.efficient.rows import PERIOD, POSES, made_up_rows

GUARDS = Guards()
ROWS = RowCounts.of(GUARDS, PERIOD)
SETTINGS = FitSettings(RowNoise.of_samples(SensorNoise(), 20, 1000.0), PERIOD)


def due(residuals: list[float]) -> list[int]:
    """The rows after which looks are due, for residuals along another mass in standard deviations."""
    schedule = ChangeTestSchedule(ROWS, GUARDS, slot=ROWS.turn - 1)
    rows = [EvaluatedRow(np.zeros(19), np.zeros(6), each, np.zeros(12)) for each in residuals]
    return [number for number, row in enumerate(rows) if schedule.is_due(number, row)]


def test_a_look_is_due_when_the_newest_rows_together_show_another_mass() -> None:
    one_look = [ROWS.turn - 1]  # in turn
    assert due([0.5] * ROWS.turn) == one_look
    until_next = ROWS.shortest // 4
    assert due([1.0] * ROWS.turn) == [*range(ROWS.shortest - 1, ROWS.turn - 1, until_next), *one_look]
    assert due([1.0, -1.0] * (ROWS.turn // 2)) == one_look


def test_rows_that_are_removed_start_no_look() -> None:
    detector, row = (
        ChangeDetector(ROWS, GUARDS, ROWS.turn - 1),
        EvaluatedRow(np.zeros(19), np.zeros(6), 1.0, np.zeros(12)),
    )
    assert not any(detector.is_due(number, row) for number in range(ROWS.shortest - 1))
    detector.take_back()
    assert not detector.is_due(ROWS.shortest - 1, row)


def test_where_the_load_has_to_be_confirmed_looks_are_of_use_again() -> None:
    detector = ChangeDetector(ROWS, GUARDS, 0)
    detector.schedule.pause(until=1000)
    detector.confirm(since=60)
    assert not detector.schedule.is_paused(60)


def test_looks_in_vain_pause_others_for_a_while_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """A window of 140 rows seems to have another load, but a fit to the rows before it says no."""
    found, look, surprise = Session(len(POSES), 0, SETTINGS, GUARDS), Innovations.look_for_change, Knowledge.surprise

    def look_for_change(self: Innovations, small: StepThresholds | None = None) -> Look:
        return Look(10, 2.0, None) if self._buffer.count == 150 else look(self, small)

    monkeypatch.setattr(Innovations, "look_for_change", look_for_change)
    monkeypatch.setattr(Knowledge, "surprise", lambda self, *a: 0.9 if self.buffer.count == 150 else surprise(self, *a))
    monkeypatch.setattr(ChangeTestSchedule, "is_due", lambda _, number, __: number >= 149)
    for number, row in enumerate(made_up_rows(150)):
        found.take(number, row)
    assert found._detector.schedule.is_paused(150)
    assert not found._detector.schedule.is_paused(150 + ROWS.turn)

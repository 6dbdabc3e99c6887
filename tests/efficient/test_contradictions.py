"""What becomes of rows while a robot's motion sensors contradict the team."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from coheft.agents.efficient.contradictions import Contradictions, Use
from coheft.agents.efficient.session import Session
from coheft.agents.efficient.settings import Guards, RowCounts
from coheft.app.run.inprocess import run_in_process
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.rows import RowNoise
from coheft.wire.messages.structs import Validity
from coheft.wire.scenario.file import load_scenario
from tests.efficient.rows import PERIOD, POSES, made_up_rows

ROWS = RowCounts.of(Guards(), PERIOD)
BURST, PAUSE = 10, 25


def certain(robot: int, rows: int) -> Array:
    """The uncertainty of predictions of which everything is known."""
    return np.zeros((12, 12))


def uses(robots: list[int], rows: RowCounts = ROWS, burst: int = BURST) -> list[Use]:
    """Uses of rows in which each of these robots contradicts the others once, with pauses in between."""
    contradictions = Contradictions(len(POSES), Guards(), np.zeros((1, 12)), rows)
    found, number = list[Use](), 100
    for robot in robots:
        for step in range(burst + PAUSE):
            residuals = np.zeros(12 * len(POSES))
            residuals[12 * robot] = 20.0 if step < burst else 0.0
            found.append(contradictions.add(number, residuals, 0, certain)[0])
            number += 1
    return found


def test_a_contradiction_ends_after_a_while_without_one() -> None:
    assert [use for use in uses([1]) if use not in (Use.KEEP, Use.LEAVE_OUT)] == [Use.BACK_TO_FIRST, Use.RESUME]


def test_one_that_lasts_means_to_start_over() -> None:
    assert Use.START_OVER in uses([1], burst=ROWS.lasting + 5)


@pytest.mark.parametrize(("robots", "starts_over"), [([1, 1, 1, 1], True), ([1, 2, 1, 2], False)])
def test_one_that_returns_again_and_again_lasts_as_well(robots: list[int], starts_over: bool) -> None:
    assert (Use.START_OVER in uses(robots)) == starts_over


def test_one_that_returns_after_a_calm_time_is_another_one() -> None:
    assert Use.START_OVER not in uses([1, 1, 1, 1], replace(ROWS, calm=PAUSE - 5))


def test_single_wrong_rows_are_no_lasting_contradiction() -> None:
    found = uses([1] * 8, burst=1)
    assert {*found} == {Use.KEEP, Use.LEAVE_OUT}


@pytest.mark.parametrize(("is_fitted", "contradicts"), [(False, True), (True, False)])
def test_residuals_at_different_estimates_are_not_summed(is_fitted: bool, contradicts: bool) -> None:
    contradictions, residuals = Contradictions(len(POSES), Guards(), np.zeros((1, 12)), ROWS), np.zeros(12 * len(POSES))
    residuals[12] = 4.0  # too little for a single row
    found = [contradictions.add(row, residuals, row if is_fitted else 0, certain)[0] for row in range(16)]
    assert (Use.BACK_TO_FIRST in found) == contradicts


def test_mean_residuals_of_few_rows_are_as_uncertain_as_their_number_says() -> None:
    rows, settings = made_up_rows(40), FitSettings(RowNoise.of_samples(SensorNoise(), 20, 1000.0), PERIOD)
    session = Session(len(POSES), 0, settings, Guards())
    for number, row in enumerate(rows[:-1]):
        session.take(number, row)
    innovations = session._known.innovations
    uncertain = innovations.motion_uncertainty(rows[-1], 1, 4)
    assert np.linalg.eigvalsh(uncertain[:6, :6])[0] >= 0.999 / innovations.past.rows


def test_what_few_rows_show_of_sensor_errors_contradicts_no_motion() -> None:
    scenario = msgspec.structs.replace(load_scenario("real3"), seed=2, duration=3.0, load_changes=())
    estimates = [each for record in run_in_process(scenario) for each in (record.estimates or {}).values()]
    assert any(estimate.status is Validity.VALID for estimate in estimates)
    assert not [reason for estimate in estimates for reason in estimate.reasons if "contradict" in reason]

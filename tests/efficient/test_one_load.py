"""What a drift of the load makes wrong in a fit that takes it to be constant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coheft.agents.efficient.one_load import OneLoad
from coheft.estimation.moments.chapter import Chapter
from coheft.estimation.moments.row_buffer import RowBuffer
from coheft.estimation.moments.rows import RowNoise
from coheft.estimation.moments.unknowns import THETA
from tests.estimation.moments.fitting import IDEAL, add_rows, fit, fit_from
from tests.estimation.moments.moving_team import NOISE, Team, make_team

QUIET = replace(IDEAL, noise=RowNoise(1e-4 * NOISE.kinematics, 1e-4 * NOISE.wrench))
DRIFT = 1e-5 * np.repeat([0.0, 1.0], [6, 10])
"""Per row, as a share of the load."""


def leaking(team: Team) -> Team:
    changed = team
    for row in range(1, len(team.motion)):
        changed = changed.holding(team.load * (1.0 + DRIFT * row), slice(row, None))
    return changed


@pytest.mark.parametrize("missing", [0, 30])
def test_a_drift_makes_poses_and_load_wrong_as_computed(missing: int) -> None:
    team, count = make_team(seed=2, number=100), 100
    found = fit(leaking(team).noisy(np.random.default_rng(3), QUIET.noise), QUIET)
    estimate, theta = found.estimate, found.estimate.body.unknowns.theta
    derivative = OneLoad(estimate, found.chapter, count, count).error_by_drift(missing)
    now = team.holding(team.load * (1.0 + DRIFT * (count - 1 + missing)))
    drift = (DRIFT * team.expressed_in(team.poses[0]).load)[THETA]
    error, expected = -found.error(now), derivative @ drift
    is_wrong = np.abs(expected) > 20.0 * np.sqrt(np.maximum(estimate.seen.diagonal(), 1e-30))
    assert is_wrong[estimate.body.unknowns.poses].any()
    assert is_wrong[theta].any()
    np.testing.assert_allclose(error[is_wrong], expected[is_wrong], rtol=0.15)


def test_rows_that_are_not_kept_or_are_part_of_a_prior_count_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    team, count = make_team(seed=2, number=100), 100
    rows = leaking(team).noisy(np.random.default_rng(3), QUIET.noise)
    whole = fit(rows, QUIET)
    expected = OneLoad(whole.estimate, whole.chapter, count, count).error_by_drift()
    theta = whole.estimate.body.unknowns.theta

    monkeypatch.setattr("coheft.estimation.moments.row_buffer.LEAST_KEPT", 40)
    dropping = Chapter(RowBuffer(rows.shape[1]), QUIET)
    add_rows(dropping.buffer, rows)
    assert not dropping.buffer.keeps_whole_load
    ended = Chapter(RowBuffer(rows.shape[1]), QUIET)
    add_rows(ended.buffer, rows[:50])
    ended.end(whole.estimate, 50)
    add_rows(ended.buffer, rows[50:], 50)
    for chapter in (dropping, ended):
        found = fit_from(whole.estimate.state, chapter, QUIET)
        kept = chapter.buffer.count
        error = OneLoad(found.estimate, chapter, kept, kept).error_by_drift()
        np.testing.assert_allclose(error[theta.start, 0], expected[theta.start, 0], rtol=0.35)

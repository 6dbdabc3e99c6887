"""A slip among the rows of one fit: calibrated without one, found with one, whoever has slipped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp
from coheft.estimation.moments.chapter import Chapter, EvidenceAt
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.likelihood import Derivatives
from coheft.estimation.moments.moments import RowMoments, evaluated_moments
from coheft.estimation.moments.pose_steps import NewestRows, PoseStep, likeliest_pose_step
from tests.estimation.moments.fitting import IDEAL, Fitted, add_rows, erring, fit, fit_from
from tests.estimation.moments.moving_team import ERRORS, Team, make_team

FALSE_ALARM = 1e-8


def slipped(team: Team, robot: int, metres: float) -> Team:
    """The grasp has slipped; what it does to the load is the same."""
    now = team.poses[robot] @ Pose(rotation_exp(np.array([0.0, 0.0, metres / 0.5])), np.array([metres, 0.0, 0.0]))
    poses, wrenches = list(team.poses), team.wrenches.copy()
    to_now = now.inverse().adjoint() @ team.poses[robot].adjoint()
    poses[robot], wrenches[:, robot] = now, wrenches[:, robot] @ to_now.T
    return replace(team, poses=tuple(poses), wrenches=wrenches)


def rows_over_slip(seed: int, robot: int, metres: float, first: int = 60, number: int = 90) -> Array:
    team, rng = make_team(seed, number=number), np.random.default_rng(seed + 7)
    return np.concatenate([team.noisy(rng)[:first], slipped(team, robot, metres).noisy(rng)[first:]])


def step_of(found: Fitted, anchor: int = 0, false_alarm: float = FALSE_ALARM) -> PoseStep:
    step = likeliest_pose_step(found.estimate, found.chapter, anchor, None, false_alarm)
    assert step is not None
    return step


def test_without_a_slip_chance_shows_as_much_as_it_should() -> None:
    """Some ten windows of two poses are tested, or searched."""
    fits = [fit(rows_over_slip(seed, 1, 0.0)) for seed in range(60)]
    shares = [np.mean([step_of(found, false_alarm=p).statistic > 1.0 for found in fits]) for p in (0.02, 0.001)]
    assert 0.1 < shares[0] < 0.5
    assert shares[1] < 0.1
    assert max(step_of(found).statistic for found in fits) < 1.0


@pytest.mark.parametrize("robot", [0, 1, 2])
@pytest.mark.parametrize("first", [30, 60, 78])
def test_a_slip_is_found_where_it_is(robot: int, first: int) -> None:
    step = step_of(fit(rows_over_slip(robot, robot, 0.003, first)))
    assert step.statistic > 1.5
    assert abs(step.first - first) <= 5
    assert step.robot == robot or (robot == 0 and step.robot in (1, 2))  # the anchor stays where it is


def test_a_slip_of_the_anchor_shows_as_that_of_another_robot() -> None:
    rows = rows_over_slip(5, 1, 0.003)
    assert step_of(fit(rows, anchor=0)).robot == 1
    step = step_of(fit(rows, anchor=1), anchor=1)
    assert step.robot in (0, 2)
    assert step.statistic > 1.5


def test_all_rows_may_be_from_after_a_slip_that_what_was_known_before_shows() -> None:
    rows = rows_over_slip(3, 2, 0.003, first=50, number=80)
    found = fit(rows[:50])
    found.chapter.end(found.estimate, 50)
    add_rows(found.chapter.buffer, rows[50:], 50)
    step = step_of(fit_from(found.estimate.state, found.chapter, IDEAL))
    assert (step.first, step.robot) == (0, 2)
    assert step.statistic > 1.5
    assert step_of(fit(rows[50:])).statistic < 0.8


def test_another_load_is_no_slip() -> None:
    """Wrenches of rows before the present load are of another one."""
    team = make_team(4, number=90)
    changed, rng = team.holding(1.5 * team.load), np.random.default_rng(1)
    rows = np.concatenate([team.noisy(rng)[:40], changed.noisy(rng)[40:]])
    found = fit(rows[:40])
    chapter: Chapter = found.chapter
    add_rows(chapter.buffer, rows[40:], 40)
    chapter.end_of_load(found.estimate, 40, True)
    step = step_of(fit_from(found.estimate.state.with_load(None), chapter, IDEAL))
    assert step.statistic < 0.8


def test_few_rows_of_nothing_that_was_known_show_nothing() -> None:
    found = fit(make_team(1, number=90).noisy(np.random.default_rng(1)))
    empty = Chapter(type(found.chapter.buffer)(found.chapter.buffer.rows.shape[1]), IDEAL)
    assert likeliest_pose_step(found.estimate, empty, 0, None, FALSE_ALARM) is None


@pytest.mark.parametrize("settings", [IDEAL, replace(IDEAL, errors=ERRORS)], ids=["exact", "with errors"])
def test_what_newest_rows_show_is_what_a_fit_to_them_alone_would_see(settings: FitSettings) -> None:
    """Mean residuals of gyros and velocity sensors are those of all newest rows, not of parts of them."""
    team = make_team(2, number=60)
    rows = erring(team, settings, np.random.default_rng(2))[1]
    found = fit(rows, settings)
    newest, body = NewestRows(found.estimate, found.chapter), found.estimate.body
    found.chapter.buffer.begin_load(30)  # wrenches before are of another load
    for first in (57, 40, 20):
        shown = newest.since(first)
    rows = found.chapter.buffer.rows
    every, of_load = RowMoments.of(rows[20:60]), RowMoments.of(rows[30:60])
    expected = EvidenceAt(Derivatives(body)).of(evaluated_moments(body, every, of_load))
    for robot, pose in enumerate(body.unknowns.poses):
        square = np.ix_(pose, pose)
        for seen, whole in (
            (shown.score, expected.score[pose]),
            (shown.information, expected.information[pose]),
            (shown.alone, (expected.information + expected.noise)[square]),
            (shown.noise, expected.noise[square]),
        ):
            np.testing.assert_allclose(seen[robot], whole, rtol=1e-6, atol=1e-8 * np.abs(whole).max())

"""Rows are missing for a while, and meanwhile the load changes, a grasp slips, or both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from coheft.agents.efficient.change_detector import ChangeDetector
from coheft.agents.efficient.knowledge import Knowledge
from coheft.agents.efficient.session import Session
from coheft.agents.efficient.settings import Guards
from coheft.agents.efficient.unnoticed import Gap
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.moments.rows import ROW_SIZE, V
from coheft.estimation.moments.unknowns import THETA
from coheft.estimation.rigid_body.mass_properties import Inertia, point_mass
from tests.efficient.rows import LOAD, PERIOD, POSES, made_up_rows
from tests.efficient.sessions import AFTER, BEFORE, before, fed, is_valid, largest_error, session, slipped_poses

GAP = 40
HEAVIER: Array = Inertia(10.0, np.array([-0.3, -0.2, 0.02]), np.diag([0.7, 0.9, 1.2])).barycentric()
SLIPPED = slipped_poses(25.0, 1.0, 2, 2)


def over_a_gap(
    load: Array = LOAD, poses: tuple[Pose, ...] = POSES, guards: Guards | None = None, after: int = AFTER
) -> tuple[Session, list[tuple[int, float]]]:
    """Return a session after a gap from which on there are this load and these poses; and the numbers of the rows at
    which it was valid since, with its largest errors in its own standard deviations.
    """
    found = before() if guards is None else fed(made_up_rows(BEFORE), guards)
    first, history = BEFORE + GAP, list[tuple[int, float]]()
    for number, row in enumerate(made_up_rows(after, load, first, poses=poses), first):
        found.take(number, row)
        if is_valid(found):
            history.append((number, largest_error(found, poses, load[0])))
    return found, history


def largest(history: list[tuple[int, float]]) -> float:
    return max(error for _, error in history)


def test_no_rows_are_missing_before_the_first_one(monkeypatch: pytest.MonkeyPatch) -> None:
    bridged = list[float]()
    monkeypatch.setattr(Knowledge, "bridge", lambda _, seconds: bridged.append(seconds))
    found = session()
    for number, row in enumerate(made_up_rows(BEFORE, first=500), 500):
        found.take(number, row)
        assert found.is_confirmed  # nothing was known before
    assert is_valid(found)
    settings, guards = found.settings, Guards()
    prior = found.hand_over(0.0)
    later = Session(len(POSES), 0, settings, guards, prior)
    bridged.clear()
    later.take(5000, made_up_rows(1, first=700)[0])
    assert not later.is_confirmed
    assert not bridged  # ``hand_over`` has done so


def with_more(mass: float) -> Array:
    return LOAD + mass * point_mass(np.array([-0.2, -0.1, 0.1]))


def deviations_of_mass(found: Session) -> tuple[float, float]:
    """Error of the mass less that of ``LOAD``, and its published standard deviation."""
    estimate = found.estimate
    assert estimate is not None
    assert estimate.state.load is not None
    mass = estimate.body.unknowns.theta.start
    return estimate.state.load[THETA.start] - LOAD[0], float(np.sqrt(found.claimable(estimate).covariance[mass, mass]))


def mass_error(found: Session, more: float, poses: tuple[Pose, ...] = POSES) -> float:
    """Largest error of the published mass over its standard deviation after a gap in which so much was put on."""
    errors, first = [0.0], BEFORE + GAP
    for number, row in enumerate(made_up_rows(60, with_more(more), first, poses=poses), first):
        found.take(number, row)
        if is_valid(found):
            off, deviation = deviations_of_mass(found)
            errors.append(abs(off - more) / deviation)
    return max(errors)


def team_after_a_gap() -> Session:
    """A session of another team, which begins after the gap."""
    former = before()
    prior = former.hand_over(GAP * PERIOD)
    assert prior is not None
    assert prior.is_after_gap
    return Session(len(POSES), 0, former.settings, Guards(), prior)


@pytest.mark.parametrize("begin", [before, team_after_a_gap], ids=["same", "another"])
def test_a_change_in_a_gap_that_is_too_small_to_be_noticed_is_covered(
    begin: Callable[[], Session], monkeypatch: pytest.MonkeyPatch
) -> None:
    masses = (0.01, 0.015, 0.02, 0.03)
    assert max(mass_error(begin(), more) for more in masses) < 5.0
    monkeypatch.setattr(Gap, "begin", lambda *_: None)
    assert any(mass_error(begin(), more) > 10.0 for more in masses)


def test_a_change_that_is_too_small_to_be_noticed_is_covered_beside_a_slip_in_the_same_gap(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert mass_error(before(), 0.01, SLIPPED) < 5.0
    monkeypatch.setattr(Gap, "begin", lambda *_: None)
    assert mass_error(before(), 0.01, SLIPPED) > 5.0


@pytest.mark.parametrize("memory", [None, 8.0])
def test_what_a_gap_hides_fades_as_rows_come(memory: float | None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ChangeDetector, "_note_step", lambda *_: None)  # chance makes some steps
    deviations = []
    for gap in (0, GAP):
        found = Session(len(POSES), 0, replace(session().settings, memory=memory), Guards())
        for number, row in enumerate(made_up_rows(BEFORE)):
            found.take(number, row)
        published = []
        for number, row in enumerate(made_up_rows(500, first=BEFORE), BEFORE):
            if number >= BEFORE + gap:
                found.take(number, row)
                published.append(deviations_of_mass(found)[1])
        deviations.append(np.array(published)[: 500 - GAP])
    ratios = deviations[1] / deviations[0]
    assert ratios[10] > 3.0
    assert ratios[-100:].max() < 2.0


def test_rows_that_are_only_late_are_no_gap() -> None:
    rows = made_up_rows(BEFORE + 60)
    found, in_order = fed(rows[:BEFORE]), fed(rows)
    late = range(BEFORE, BEFORE + 10)
    for number in (BEFORE + 10, *late, *range(BEFORE + 11, BEFORE + 60)):
        found.take(number, rows[number])
        if number == BEFORE + 10:
            assert deviations_of_mass(found)[1] > 3.0 * deviations_of_mass(in_order)[1]
    assert deviations_of_mass(found)[1] < 1.2 * deviations_of_mass(in_order)[1]


def test_all_robots_have_the_same_poses_after_a_gap_and_another_load() -> None:
    poses = []
    for own in (0, 2):
        found = session(own=own)
        for number, row in enumerate(made_up_rows(BEFORE)):
            found.take(number, row)
        for first, load in ((BEFORE + GAP, LOAD), (BEFORE + GAP + 100, HEAVIER)):
            for number, row in enumerate(made_up_rows(100, load, first), first):
                found.take(number, row)
        assert found.estimate is not None
        poses.append([pose.numbers() for pose in found.estimate.state.poses])
    np.testing.assert_allclose(poses, poses[:1] * len(poses), atol=1e-12)


def test_a_slip_in_a_gap_is_named() -> None:
    found, history = over_a_gap(poses=SLIPPED)
    assert [slip.robot for slip in found.causes.slips] == [2]
    assert found.causes.slips[0].first == BEFORE + GAP
    assert found.causes.changes == []
    assert history[0][0] < BEFORE + GAP + 0.6 / PERIOD
    assert largest(history) < 5.0


def test_a_slip_and_another_load_in_one_gap_are_both_named() -> None:
    found, history = over_a_gap(HEAVIER, SLIPPED)
    assert [slip.robot for slip in found.causes.slips] == [2]
    assert [change.first for change in found.causes.certain_changes] == [BEFORE + GAP]
    assert found.causes.changes[0].former == pytest.approx(LOAD, abs=0.05)
    assert history[0][0] < BEFORE + GAP + 1.0 / PERIOD
    assert largest(history) < 5.0


def test_another_load_alone_is_no_slip() -> None:
    found, history = over_a_gap(HEAVIER)
    assert found.causes.slips == []
    assert [change.first for change in found.causes.certain_changes] == [BEFORE + GAP]
    assert history[0][0] < BEFORE + GAP + 0.6 / PERIOD
    assert largest(history) < 5.0


def test_where_nothing_has_changed_all_is_valid_again_at_once() -> None:
    found, history = over_a_gap()
    assert found.causes.slips == found.causes.changes == []
    assert [number for number, _ in history] == [*range(history[0][0], BEFORE + GAP + AFTER)]
    assert history[0][0] < BEFORE + GAP + 0.2 / PERIOD
    assert largest(history) < 5.0


@pytest.mark.parametrize("load", [LOAD, HEAVIER], ids=["same-load", "heavier"])
def test_while_a_slip_is_likelier_nothing_is_valid(load: Array) -> None:
    poses = slipped_poses(8.0, 0.3, 1, 8)
    _, careless = over_a_gap(load, poses, replace(Guards(), doubted=1e-300))
    _, careful = over_a_gap(load, poses)
    assert largest(careless) > 5.0
    assert largest(careful) < 5.0


def test_a_small_slip_in_a_gap_is_named_after_a_while() -> None:
    found, _ = over_a_gap(poses=slipped_poses(8.0, 0.0, 2, 9))
    assert [slip.robot for slip in found.causes.slips] == [2]


def test_after_a_long_doubt_poses_are_found_anew() -> None:
    poses = slipped_poses(8.0, 0.0, 3, 10)
    found, history = over_a_gap(HEAVIER, poses)
    assert found.causes.slips == []
    assert not found.causes.is_open
    assert history[0][0] > BEFORE + GAP + 3.0 / PERIOD
    assert history[-1][0] == BEFORE + GAP + AFTER - 1
    assert largest(history) < 5.0


def test_once_all_is_estimated_anew_it_does_not_matter_what_has_changed_in_the_gap() -> None:
    poses = slipped_poses(8.0, 0.0, 3, 10)
    found, _ = over_a_gap(HEAVIER, poses, after=30)
    assert found.causes.is_open
    found._start_over()
    first, history = BEFORE + GAP + 30, list[tuple[int, float]]()
    for number, row in enumerate(made_up_rows(100, HEAVIER, first, poses=poses), first):
        found.take(number, row)
        if is_valid(found):
            history.append((number, largest_error(found, poses, HEAVIER[0])))
    assert history[0][0] < first + 0.8 / PERIOD
    assert largest(history) < 5.0


@pytest.mark.parametrize("newcomer", [1, 3])
def test_a_slip_of_the_anchor_is_named_also_if_another_robot_joins_in_the_same_gap(newcomer: int) -> None:
    former, poses = before(), slipped_poses(20.0, 1.0, 0, 4)
    prior = former.hand_over(0.0)
    assert prior is not None
    members = [None if robot == newcomer else robot for robot in range(len(POSES))]
    settings = former.settings
    found = Session(len(POSES), 0, settings, Guards(), prior.for_team(members, settings, settings))
    for number, row in enumerate(made_up_rows(60, first=BEFORE, poses=poses)):
        found.take(number, row)
    assert [slip.robot for slip in found.causes.slips] == [0]
    assert is_valid(found)
    assert largest_error(found, poses) < 5.0


def test_a_second_gap_hides_no_slip_in_the_first() -> None:
    found, first = before(), BEFORE + GAP
    rows, history = made_up_rows(AFTER, HEAVIER, first, poses=SLIPPED), []
    for number in [*range(first, first + 9), *range(first + 20, first + AFTER)]:
        found.take(number, rows[number - first])
        if is_valid(found):
            history.append((number, largest_error(found, SLIPPED, HEAVIER[0])))
    assert [slip.robot for slip in found.causes.slips] == [2]
    assert largest(history) < 5.0


@pytest.mark.parametrize("gap", [0, GAP], ids=["no-gap-before", "shortly-after-a-gap"])
def test_all_may_have_changed_while_a_sensor_was_off(gap: int) -> None:
    poses = slipped_poses(8.0, 0.3, 2, 9)
    off, later = range(BEFORE + gap + 10, BEFORE + gap + 60), BEFORE + gap + 35
    rows = np.concatenate([made_up_rows(later), made_up_rows(AFTER, HEAVIER, later, poses=poses)])
    rows[off.start : off.stop, 3 * ROW_SIZE + V.start] += 0.3
    found, history = before(), []
    for number in range(BEFORE + gap, len(rows)):
        found.take(number, rows[number])
        if number >= off.stop and is_valid(found):
            history.append(largest_error(found, poses, HEAVIER[0]))
    assert [slip.robot for slip in found.causes.slips] == [2]
    assert max(history) < 5.0


def test_a_slip_soon_after_a_robot_has_joined_is_named() -> None:
    """The rows before it are compared at the newcomer's present pose."""
    former, poses = before(), slipped_poses(20.0, 0.5, 2, 7)
    prior, settings = former.hand_over(0.0), former.settings
    assert prior is not None
    found = Session(len(POSES), 0, settings, Guards(), prior.for_team([0, 1, 2, None], settings, settings))
    rows = [made_up_rows(5, first=BEFORE), made_up_rows(145, first=BEFORE + 5, poses=poses)]
    for number, row in enumerate(np.concatenate(rows)):
        found.take(number, row)
    assert [slip.robot for slip in found.causes.slips] == [2]
    assert is_valid(found)
    assert largest_error(found, poses) < 5.0


@pytest.mark.parametrize("rows", [5, 8])
def test_a_load_that_is_put_on_in_a_gap_and_soon_taken_off_again_leaves_no_doubt(rows: int) -> None:
    found, first, history = before(), BEFORE + GAP, list[tuple[int, float]]()
    heavier, after = made_up_rows(rows, HEAVIER, first), made_up_rows(AFTER, LOAD, first + rows)
    for number, row in enumerate(np.concatenate([heavier, after]), first):
        found.take(number, row)
        if is_valid(found):
            history.append((number, largest_error(found, POSES)))
    assert history[0][0] < first + rows + 1.0 / PERIOD
    assert largest(history) < 5.0

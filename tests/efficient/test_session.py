"""A robot's estimate, row by row: independent of the order of rows and of who makes it, and hard to upset."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.agents.efficient.change_detector import Confirmation
from coheft.agents.efficient.judge import Outcome
from coheft.agents.efficient.session import Session
from coheft.agents.efficient.settings import Guards, RowCounts
from coheft.agents.efficient.stages import STAGE_AFTER, Event, ResetMonitor, Stage
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.moments.claims import claim_of
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.rows import FORCE, ROW_SIZE, WRENCH, A, RowNoise
from tests.efficient.rows import LOAD, PERIOD, POSES, made_up_rows
from tests.efficient.sessions import BEFORE, slipped, slipped_poses

COUNT = len(POSES)
SETTINGS = FitSettings(RowNoise.of_samples(SensorNoise(), 20, 1000.0), PERIOD)


def session(own: int = 0) -> Session:
    return Session(COUNT, own, SETTINGS, Guards())


def fed(rows: Array, own: int = 0, order: list[int] | None = None) -> Session:
    found = session(own)
    for number in range(len(rows)) if order is None else order:
        found.take(number, rows[number])
    return found


def state_of(found: Session) -> Array:
    assert found.estimate is not None
    assert found.estimate.state.load is not None
    return np.concatenate([*(pose.numbers() for pose in found.estimate.state.poses), found.estimate.state.load])


def assert_right(found: Session, load: Array = LOAD) -> None:
    """All ten numbers are known, and within five standard deviations of the truth."""
    assert found.stage is Stage.ESTIMATING
    assert found.estimate is not None
    assert claim_of(found.estimate, 0).known == 10
    theta = found.estimate.body.unknowns.theta
    state = found.estimate.state
    assert state.load is not None
    deviations = np.sqrt(found.estimate.covariance.diagonal()[theta])
    assert np.abs((state.load[6:] - load) / deviations).max() < 5.0
    for pose, true in zip(state.poses, POSES, strict=True):
        assert np.abs(pose.translation - true.translation).max() < 0.02


def test_the_load_is_known_soon_and_right() -> None:
    assert_right(fed(made_up_rows(150)))


def test_late_rows_make_no_difference() -> None:
    rows = made_up_rows(200)
    rng = np.random.default_rng(1)
    # Each row comes up to six places late; the last ones in order, so that the last fit has the same rows.
    order = sorted(range(180), key=lambda number: number + 6.0 * rng.random()) + list(range(180, 200))
    in_order, late = fed(rows), fed(rows, order=order)
    for found in (in_order, late):
        found._known.fit()
        found._known.fit()
    np.testing.assert_allclose(state_of(late), state_of(in_order), atol=1e-9)


def test_all_robots_come_to_the_same_but_for_their_frames() -> None:
    rows = made_up_rows(150)
    one, other = fed(rows), fed(rows, own=2)
    for found in (one, other):
        for _ in range(3):
            found._known.fit()
    assert one.estimate is not None
    assert other.estimate is not None
    to_one, to_other = one.estimate.state.poses[2], other.estimate.state.poses[2]
    for mine, its in zip(one.estimate.state.poses, other.estimate.state.poses, strict=True):
        there = to_one.inverse() @ mine
        expected = to_other.inverse() @ its
        np.testing.assert_allclose(there.numbers(), expected.numbers(), atol=1e-9)
    for robot in range(COUNT):
        mine, its = claim_of(one.estimate, robot), claim_of(other.estimate, robot)
        assert mine.inertia is not None
        assert its.inertia is not None
        assert mine.inertia.mass == pytest.approx(its.inertia.mass, rel=1e-9)
        np.testing.assert_allclose(mine.inertia.tensor, its.inertia.tensor, atol=1e-9)
        np.testing.assert_allclose(mine.covariance, its.covariance, rtol=1e-5, atol=1e-12)


def test_another_load_is_noticed_within_two_rows_and_known_soon() -> None:
    heavier = LOAD.copy()
    heavier[0] *= 1.05
    rows = np.concatenate([made_up_rows(200), made_up_rows(100, load=heavier, first=200)])
    found = session()
    for number, row in enumerate(rows):
        found.take(number, row)
        if number == 203:
            assert [change.first for change in found.causes.changes] == pytest.approx([200], abs=1)
    assert len(found.causes.changes) == 1
    assert_right(found, heavier)


def test_a_robot_whose_sensor_is_off_is_named_and_its_rows_are_not_learned_from() -> None:
    rows = made_up_rows(200)
    rows[150:170, ROW_SIZE + A.start] += 0.5
    found = session()
    for number, row in enumerate(rows):
        found.take(number, row)
        if 152 < number < 170:
            assert found.contradicting == 1
    assert found.contradicting is None
    assert_right(found)
    clean = fed(np.delete(made_up_rows(200), range(150, 170), axis=0))
    np.testing.assert_allclose(state_of(found), state_of(clean), atol=2e-2)


def carried_by(robots: tuple[int, ...], rows: Array, poses: tuple[Pose, ...] = POSES) -> Array:
    """Rows of only these robots, of which the first carries what the others have carried."""
    whole = rows[:, :-1].copy().reshape(len(rows), len(POSES), ROW_SIZE)
    for robot in {*range(len(POSES))} - {*robots}:
        to_first = (poses[robots[0]].inverse() @ poses[robot]).adjoint()
        whole[:, robots[0], WRENCH] += whole[:, robot, WRENCH] @ to_first.T
    return np.hstack([whole[:, robots].reshape(len(rows), -1), rows[:, -1:]])


@pytest.mark.parametrize("seed", range(3))
def test_a_robot_that_holds_the_load_alone_tells_no_slip(seed: int) -> None:
    noise = RowNoise.of_samples(SensorNoise().scaled(3.0), 20, 1000.0)  # that of all robots' wrenches together
    poses, found = slipped_poses(20.0, 1.0, 0, seed), Session(1, 0, FitSettings(noise, PERIOD), Guards())
    rows = [made_up_rows(150), made_up_rows(120, first=162, poses=poses)]
    for number, row in enumerate(carried_by((0,), rows[0])):
        found.take(number, row)
    for number, row in enumerate(carried_by((0,), rows[1], poses), 162):
        found.take(number, row)
    assert not found.causes.slips
    assert [140 < change.first <= 162 for change in found.causes.changes] == [True]


@pytest.mark.parametrize(("force", "torque"), [((1.0, 0.5, 0.5, 0.5), 0.1), (0.5, (0.1, 0.1, 0.1, 0.2))])
def test_offsets_of_forces_may_differ_between_robots_where_those_of_torques_do_not(
    force: float | tuple[float, ...], torque: float | tuple[float, ...]
) -> None:
    noise, of_force, of_torque = RowNoise.of_samples(SensorNoise(), 20, 1000.0), np.array(force), np.array(torque)
    found = Session(4, 0, FitSettings(noise, PERIOD, force_offset=of_force, torque_offset=of_torque), Guards())
    for number, row in enumerate(made_up_rows(60)):
        found.take(number, row)
    assert found.stage is Stage.ESTIMATING


@pytest.mark.parametrize("pair", [(0, 1), (0, 2), (1, 3)])
def test_two_robots_of_which_only_forces_may_be_off_estimate_the_load(pair: tuple[int, int]) -> None:
    noise = RowNoise.of_samples(SensorNoise(), 20, 1000.0)
    found = Session(2, 0, FitSettings(noise, PERIOD, force_offset=0.5), Guards())
    rows = np.concatenate([made_up_rows(120), made_up_rows(80, 1.1 * LOAD, 120)])
    for number, row in enumerate(carried_by(pair, rows)):
        found.take(number, row)
    assert found.stage is not Stage.GATHERING
    assert [change.first for change in found.causes.changes] == [120]


def test_a_single_row_that_contradicts_is_left_out_and_the_second_one_makes_a_suspect() -> None:
    rows = made_up_rows(200)
    rows[[150, 180, 182], ROW_SIZE + A.start] += 0.5
    found, suspected = session(), []
    for number, row in enumerate(rows):
        found.take(number, row)
        if found.contradicting is not None:
            suspected.append(number)
            assert found.contradicting == 1
    assert suspected[0] == 182
    without = fed(np.delete(rows, [150, 180, 182], axis=0))
    np.testing.assert_allclose(state_of(found), state_of(without), atol=2e-2)


@pytest.mark.parametrize("size", [1.5, 6.0, 60.0])
def test_a_force_sensor_that_is_off_is_not_taken_for_another_load(size: float) -> None:
    rows = made_up_rows(260)
    rows[150:, 2 * ROW_SIZE + FORCE.start] += size
    found, rivals = session(), set()
    for number, row in enumerate(rows):
        found.take(number, row)
        rivals.add(found.verdict.rival)
        if number > 165:
            assert found.stage is not Stage.ESTIMATING
    assert rivals <= {None, (2, "force")}


def test_what_was_known_holds_after_missing_rows_only_when_it_fits_new_ones() -> None:
    rows = made_up_rows(240)
    found = fed(rows[:150])
    assert found.is_confirmed
    found.take(200, rows[200])
    assert not found.is_confirmed
    for number in range(201, 212):
        found.take(number, rows[number])
    assert found.is_confirmed
    assert_right(found)


def test_every_event_leads_to_a_stage_and_every_stage_can_be_reached() -> None:
    assert set(STAGE_AFTER) == set(Event)
    assert set(STAGE_AFTER.values()) == set(Stage)


def test_a_sensor_that_was_off_at_first_makes_all_begin_again() -> None:
    rows = made_up_rows(120)
    rows[:12, ROW_SIZE + A.start] += 0.3
    found, outcomes = session(), set()
    for number, row in enumerate(rows):
        found.take(number, row)
        outcomes.add(found.verdict.outcome)
        if number < 25:
            assert found.stage is not Stage.ESTIMATING
    assert Outcome.NO_BODY in outcomes
    assert_right(found)


def test_rows_from_before_all_began_again_that_come_late_are_not_used() -> None:
    rows, late = made_up_rows(120), range(6, 12)
    rows[:15, ROW_SIZE + A.start] += 0.3  # the first fits show it
    numbers = [number for number in range(120) if number not in late]
    begun = numbers.index(40)
    found, without = session(), session()
    for number in [*numbers[:begun], *late, *numbers[begun:]]:
        found.take(number, rows[number])
        if number not in late:
            without.take(number, rows[number])
    assert np.array_equal(state_of(found), state_of(without))
    assert_right(found)


def test_without_a_load_that_fits_poses_are_found_anew() -> None:
    rows = made_up_rows(900)
    rows[150:700, ROW_SIZE + FORCE.start] += np.random.default_rng(3).normal(size=550)
    found, starts, had_poses = session(), list[int](), False
    for number, row in enumerate(rows):
        found.take(number, row)
        if had_poses and found.estimate is None:
            starts.append(number)
        had_poses = found.estimate is not None
    assert starts
    assert 300 < starts[0] < 400
    assert_right(found)


def test_wrenches_are_distrusted_for_a_limited_time_only() -> None:
    rows = RowCounts.of(Guards(), PERIOD)
    confirmation = Confirmation(rows)
    assert not confirmation.fits_badly(10)
    assert not confirmation.fits_badly(10 + rows.lasting)
    assert confirmation.fits_badly(11 + rows.lasting)
    confirmation.count()  # a row that fits
    assert not confirmation.fits_badly(12 + rows.lasting)


def test_rows_that_nothing_has_confirmed_stay_so_when_more_are_missing() -> None:
    rows = RowCounts.of(Guards(), PERIOD)
    confirmation = Confirmation(rows)
    confirmation.begin(since=100)
    confirmation.begin(since=110)
    assert confirmation.since == 100
    for _ in range(rows.confirming):
        confirmation.count()
    confirmation.begin(since=120)
    assert confirmation.since == 120


def test_what_may_be_of_another_load_is_not_handed_over() -> None:
    found = fed(made_up_rows(150))
    assert found.hand_over(0.0) is not None
    found._detector.confirmation.fits_badly(149)
    found._detector.schedule.pause(until=1000)
    assert found.hand_over(0.0) is None


def test_rows_that_came_with_a_contradiction_are_taken_back() -> None:
    rows = made_up_rows(120)
    rows[100:104, ROW_SIZE + A.start] += 0.085  # too little for a single row
    found = fed(rows[:100])
    before = found._known.buffer.count
    for number in range(100, 104):
        found.take(number, rows[number])
    assert found.contradicting == 1
    assert found._known.buffer.count < before + 3


def test_after_rows_are_taken_back_those_before_count_and_new_ones_have_to_confirm_them() -> None:
    rows = made_up_rows(150)
    found = fed(rows[:140])
    assert found.is_confirmed
    found.take_back(120)
    assert not found.is_confirmed
    np.testing.assert_allclose(state_of(found), state_of(fed(rows[:120])), atol=2e-2)
    for number in range(120, 150):
        found.take(number, rows[number])
    assert found.is_confirmed
    assert_right(found)


def test_where_taking_back_leaves_few_rows_all_begins_again() -> None:
    rows = made_up_rows(80)
    found = fed(rows[:60])
    assert found.stage is Stage.ESTIMATING
    found.take_back(3)
    assert found.stage is Stage.GATHERING
    for number in range(3, 80):
        found.take(number, rows[number])
    assert_right(found)


def test_rows_that_have_made_room_count_in_tests_for_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("coheft.estimation.moments.row_buffer.LEAST_KEPT", 64)
    rows = made_up_rows(129)
    known = fed(rows)._known
    assert known.buffer.count == 65
    assert known.innovations.gram()[0, 0] == pytest.approx(len(rows))


def test_the_total_wrench_of_the_newest_row_is_told() -> None:
    rows = made_up_rows(100)
    found = fed(rows)
    assert found.estimate is not None
    total = sum(
        pose.adjoint() @ rows[-1, ROW_SIZE * robot + FORCE.start : ROW_SIZE * robot + FORCE.start + 6]
        for robot, pose in enumerate(POSES)
    )
    np.testing.assert_allclose(found.total_wrench, total, atol=2.0)
    assert np.linalg.norm(total[:3]) > 50.0


def test_a_contradiction_after_a_load_change_does_not_hasten_the_fit() -> None:
    rows = np.concatenate([made_up_rows(100), made_up_rows(60, 1.3 * LOAD, first=100)])
    rows[106:116, 2 * ROW_SIZE + A.start] += 0.1
    found = session()
    for number, row in enumerate(rows):
        found.take(number, row)
        if found.causes.changes and found.stage is Stage.ESTIMATING:
            break
    assert found._known.buffer.load_rows >= found._known.least


def test_no_total_wrench_of_former_poses_is_told() -> None:
    found = fed(made_up_rows(60))
    assert found.total_wrench is not None
    found._start_over()
    assert found.total_wrench is None


@pytest.mark.parametrize(("calms", "was_known", "begins"), [(0.5, True, True), (2.0, True, False), (2.0, False, True)])
def test_loads_that_are_forgotten_soon_or_before_they_are_known_make_all_begin_again(
    calms: float, was_known: bool, begins: bool
) -> None:
    rows = RowCounts.of(Guards(), PERIOD)
    monitor, apart = ResetMonitor(rows), round(calms * rows.calm)
    numbers = range(10 * rows.restless, 10 * rows.restless + 10 * apart, apart)
    found = [monitor.forget_load(number, was_known) for number in numbers]
    assert not found[0]
    assert any(found) == begins


def test_a_slip_does_not_end_the_trouble_with_loads() -> None:
    rows, _ = slipped(20.0, 1.0, 1, 3)
    found = fed(rows[:BEFORE])
    found._resets.forget_load(BEFORE - 1, True)
    before = found._resets
    for number in range(BEFORE, BEFORE + 60):
        found.take(number, rows[number])
    assert found.causes.slips
    assert found._resets is before
    found._start_over()
    assert found._resets is not before

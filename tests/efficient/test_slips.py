"""A grasp that slips: named, never called a load, and all else stays known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coheft.agents.efficient.innovations import Innovations
from coheft.agents.efficient.session import Session
from coheft.agents.efficient.settings import Guards
from coheft.agents.efficient.slips import State
from coheft.agents.efficient.stages import Stage
from coheft.agents.efficient.state_before_change import StateBeforeChange
from coheft.agents.efficient.unnoticed import Unnoticed
from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.moments.chapter import Chapter
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.row_buffer import RowBuffer
from coheft.estimation.moments.rows import FORCE, ROW_SIZE, TORQUE, A, RowNoise, V, W
from coheft.estimation.rigid_body.mass_properties import point_mass
from tests.efficient.rows import LOAD, PERIOD, POSES, made_up_rows
from tests.efficient.sessions import AFTER, BEFORE, fed, is_valid, largest_error, session, slipped, slipped_poses


@pytest.mark.parametrize("seed", [1, 2, 4])  # of robots 1, 2, and 0, whose pose fixes the body frame
def test_a_large_slip_is_named_at_once_and_never_called_a_load(seed: int) -> None:
    rows, poses = slipped(20.0, 1.0, seed % 4, seed)
    found, wrong = session(), []
    for number, row in enumerate(rows):
        found.take(number, row)
        if number > BEFORE + 2 and is_valid(found):
            wrong.append(largest_error(found, poses))
    (slip,) = found.causes.slips
    assert slip.robot == seed % 4
    assert slip.named < BEFORE + 0.3 / PERIOD
    assert slip.first == pytest.approx(BEFORE, abs=2)
    assert found.causes.changes == []
    assert len(wrong) > AFTER - 20
    assert max(wrong) < 5.0


@pytest.mark.parametrize("seed", [1, 4])
def test_a_slip_that_looks_like_a_load_at_first_is_told_from_one(seed: int) -> None:
    rows, poses = slipped(10.0, 0.0, seed % 4, seed)
    found = fed(rows)
    assert [slip.robot for slip in found.causes.slips] == [seed % 4]
    assert found.causes.changes == []
    assert largest_error(found, poses) < 5.0
    assert is_valid(found)


def test_from_the_suspicion_to_the_verdict_nothing_is_valid() -> None:
    rows, _ = slipped(10.0, 0.0, 2, 2)
    found, valid = session(), []
    for number, row in enumerate(rows):
        found.take(number, row)
        if is_valid(found):
            valid.append(number)
    (slip,) = found.causes.slips
    assert slip.noticed < slip.named
    assert not {*range(slip.noticed, slip.named + 1)} & {*valid}
    assert valid[-1] == len(rows) - 1


@pytest.mark.parametrize("column", [A.start, V.start, W.start, FORCE.start, TORQUE.start])
def test_a_sensor_that_is_off_is_no_slip(column: int) -> None:
    rows = made_up_rows(300)
    rows[BEFORE:, ROW_SIZE + column] += {FORCE.start: 3.0, TORQUE.start: 0.3}.get(column, 0.2)
    assert fed(rows).causes.slips == []


def test_motion_sensors_that_are_knocked_are_no_slip() -> None:
    """What they read is that of a grasp elsewhere; wrenches are not."""
    rows, _ = slipped(0.0, 2.0, 1, 1)
    for column in (FORCE, TORQUE):
        own = slice(ROW_SIZE + column.start, ROW_SIZE + column.stop)
        rows[BEFORE:, own] = made_up_rows(AFTER, first=BEFORE)[:, own]
    assert fed(rows).causes.slips == []


def test_of_two_slips_each_is_named() -> None:
    rows, poses = slipped(20.0, 1.0, 1, 1)
    again = list(poses)
    again[3] = again[3] @ Pose(rotation_exp(np.array([0.02, 0.0, 0.0])), np.array([0.0, 0.015, 0.0]))
    rows = np.concatenate([rows, made_up_rows(200, first=len(rows), seed=1, poses=tuple(again))])
    found = fed(rows)
    assert [slip.robot for slip in found.causes.slips] == [1, 3]
    assert largest_error(found, tuple(again)) < 5.0


@pytest.mark.parametrize("seed", [3, 4, 5, 6, 7, 9])
def test_a_slip_that_is_hidden_in_fits_is_found_nevertheless(seed: int) -> None:
    """Fits to rows from before and after it have poses in between, with residuals like noise."""
    poses, found = slipped_poses(3.0, 0.2, seed % 4, seed), session()
    rows = [made_up_rows(80, seed=seed), made_up_rows(160, first=80, seed=seed, poses=poses)]
    errors = list[float]()
    for number, row in enumerate(np.concatenate(rows)):
        found.take(number, row)
        if number > 80 + 1.5 / PERIOD and is_valid(found):
            errors.append(largest_error(found, poses))
    assert len(errors) > 40
    assert max(errors) < 5.0


def test_it_is_looked_for_again_when_rows_are_taken_back() -> None:
    poses, found = slipped_poses(3.0, 0.2, 1, 5), session()
    rows = [made_up_rows(80, seed=5), made_up_rows(160, first=80, seed=5, poses=poses)]
    for number, row in enumerate(np.concatenate(rows)):
        found.take(number, row)
        if found.causes.is_open:
            break
    assert largest_error(found, poses) > 5.0
    found.take_back(number)
    assert not is_valid(found)
    assert found.causes.is_open


def shifted(by: float, axis: int) -> Array:
    """Rows over a part of the load of 2 kg that shifts so far along an axis [m]: at first, that looks like a slip."""
    there = np.array([-0.35, -0.25, 0.02])
    load = LOAD + 2.0 * (point_mass(there + by * np.eye(3)[axis]) - point_mass(there))
    return np.concatenate([made_up_rows(200), made_up_rows(250, load=load, first=200)])


def test_robots_start_over_once_although_a_pose_had_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    found, again = session(), list[int]()
    for number, row in enumerate(shifted(0.005, 2)):
        found.take(number, row)
        if found.causes.is_open and not again:
            again.append(number)
            found._start_over()
            monkeypatch.setattr(Session, "_start_over", lambda self: again.append(-1))
    assert len(again) == 1
    assert is_valid(found)
    assert largest_error(found, POSES) < 5.0


def test_a_shift_of_the_load_that_shows_as_another_pose_is_no_reason_to_start_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    noticed = list[State]()
    suspect = Session._suspect
    monkeypatch.setattr(
        Session, "_suspect", lambda self, index, state: (noticed.append(state), suspect(self, index, state))[1]
    )
    monkeypatch.setattr(Session, "_start_over", lambda self: pytest.fail("all was forgotten"))
    found = fed(shifted(0.006, 0))
    assert noticed[:1] == [State.POSE_CHANGED]
    assert State.LOAD_OR_SLIP in noticed
    assert found.causes.slips == []
    assert len(found.causes.certain_changes) == 1
    assert is_valid(found)


def test_a_small_slip_soon_after_another_load_is_found() -> None:
    """The load change is settled by then, so no causes are compared any more, until newest rows show another pose."""
    heavier, poses = LOAD + 2.0 * point_mass(np.array([0.1, 0.2, 0.0])), slipped_poses(4.0, 0.2, 3, 3)
    slips_at = BEFORE + 30
    rows = [made_up_rows(BEFORE, seed=3), made_up_rows(30, heavier, BEFORE, 3)]
    rows.append(made_up_rows(160, heavier, slips_at, 3, poses))
    found, worst = session(), 0.0
    for number, row in enumerate(np.concatenate(rows)):
        found.take(number, row)
        if number > slips_at + 75 and is_valid(found):
            worst = max(worst, largest_error(found, poses, heavier[0]))
    assert [slip.robot for slip in found.causes.slips] == [3]
    assert worst < 5.0


@pytest.mark.parametrize("seed", [3, 4])
def test_nothing_is_handed_over_while_newest_rows_show_another_pose(seed: int) -> None:
    """A fault of another robot hides the slip, so only the fit before the hand-over shows it."""
    rows = made_up_rows(42, first=BEFORE, seed=seed, poses=slipped_poses(3.0, 0.15, 2, seed))
    rows[30:, ROW_SIZE + A.start] += 3.0
    found = fed(np.concatenate([made_up_rows(BEFORE, seed=seed), rows]))
    assert not found.causes.is_open
    assert found.hand_over(0.1) is None
    assert found.causes.is_open


def test_a_slip_that_removed_rows_have_shown_is_forgotten() -> None:
    rows, _ = slipped(20.0, 1.0, 1, 3)
    found = fed(rows[: BEFORE + 40])
    assert len(found.causes.slips) == 1
    found.take_back(BEFORE - 20)
    assert found.causes.slips == []


def test_after_a_slip_among_the_first_rows_of_all_nothing_from_before_is_kept() -> None:
    """The first fit is to rows from before and after it, so nothing that it is compared with is from before."""
    poses = slipped_poses(5.0, 0.3, 1, 5)
    rows = np.concatenate([made_up_rows(8, seed=5), made_up_rows(160, first=8, seed=5, poses=poses)])
    numbers, found = iter(range(len(rows))), session()
    while not found.causes.slips:
        number = next(numbers)
        found.take(number, rows[number])
    assert found.stage is Stage.GATHERING
    assert found.estimate is None
    for number in numbers:
        found.take(number, rows[number])
    assert is_valid(found)
    assert largest_error(found, poses) < 5.0


def test_what_was_known_stays_the_same_where_a_pose_is_filled_in() -> None:
    known = fed(made_up_rows(BEFORE))._known
    assert known.estimate is not None
    before = StateBeforeChange.of(known, BEFORE, Unnoticed(), 0)
    hidden, own = before.estimate.hidden.copy(), before.estimate.body.unknowns.poses[2]
    hidden[own, own] += 1.0
    poses = list(known.estimate.state.poses)
    poses[2] = poses[2] @ Pose(rotation_exp(np.array([0.0, 0.0, 1e-3])), np.array([1e-3, 0.0, 0.0]))
    former = replace(before.prior.state, poses=tuple(poses))
    moved = before._replace(
        estimate=replace(before.estimate, hidden=hidden), prior=replace(before.prior, state=former)
    ).with_poses_of(known)
    assert moved is not None
    body = known.estimate.body
    there, here = moved.prior.at(body).score, replace(before.prior, state=former).at(body).score
    scale = np.sqrt(before.prior.evidence.information.diagonal())
    seen = scale > 0.0
    assert (there - here)[seen] / scale[seen] == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_load_that_makes_a_grasp_slip_is_told_from_the_slip(seed: int) -> None:
    heavier, poses = LOAD + 2.0 * point_mass(np.array([0.1, 0.2, 0.0])), slipped_poses(25.0, 1.0, seed, seed)
    rows = np.concatenate([made_up_rows(BEFORE, seed=seed), made_up_rows(AFTER, heavier, BEFORE, seed, poses)])
    found, worst = session(), 0.0
    for number, row in enumerate(rows):
        found.take(number, row)
        if number > BEFORE + 2 and is_valid(found):
            worst = max(worst, largest_error(found, poses, heavier[0]))
    (slip,), (change,) = found.causes.slips, found.causes.certain_changes
    assert slip.robot == seed
    assert slip.named < BEFORE + 0.5 / PERIOD
    assert change.first == pytest.approx(BEFORE, abs=2)
    assert is_valid(found)
    assert worst < 5.0


def test_a_sensor_that_is_off_for_a_moment_after_a_load_change_is_no_slip() -> None:
    heavier = LOAD + 2.0 * point_mass(np.array([0.1, 0.2, 0.0]))
    rows = np.concatenate([made_up_rows(BEFORE), made_up_rows(AFTER, heavier, BEFORE)])
    rows[BEFORE + 9 : BEFORE + 15, ROW_SIZE + V.start] += 0.2
    found = fed(rows[: BEFORE + 60])
    assert found.causes.slips == []
    assert is_valid(found)
    assert largest_error(found, POSES, heavier[0]) < 5.0


def test_rows_from_before_a_slip_that_come_late_are_not_used() -> None:
    rows, poses = slipped(20.0, 1.0, 1, 3)
    late, found, errors = range(BEFORE - 10, BEFORE - 4), session(), list[float]()
    numbers = [number for number in range(BEFORE + 60) if number not in late]
    named = numbers.index(BEFORE + 20)
    for number in [*numbers[:named], *late, *numbers[named:]]:
        found.take(number, rows[number])
        if number >= BEFORE + 20 and is_valid(found):
            errors.append(largest_error(found, poses))
    assert [slip.robot for slip in found.causes.slips] == [1]
    assert len(errors) > 30
    assert max(errors) < 5.0


def mass_error(found: Session, mass: float) -> float:
    """Error of the published mass, in its own standard deviations."""
    assert found.estimate is not None
    assert found.estimate.state.load is not None
    estimate = found.claimable(found.estimate)
    deviation = np.sqrt(estimate.covariance.diagonal()[estimate.body.unknowns.theta.start])
    return float(abs(found.estimate.state.load[6] - mass) / deviation)


def test_after_a_slip_a_change_that_had_not_been_noticed_is_still_covered() -> None:
    less, poses = LOAD - 0.012 * point_mass(np.array([-0.2, -0.1, 0.1])), slipped_poses(20.0, 1.0, 1, 3)
    parts = [made_up_rows(300), made_up_rows(40, less, 300), made_up_rows(40, less, 340, poses=poses)]
    found, worst = session(), 0.0
    for number, row in enumerate(np.concatenate(parts)):
        found.take(number, row)
        if number > 345 and is_valid(found):
            worst = max(worst, mass_error(found, less[0]))
    assert [slip.robot for slip in found.causes.slips] == [1]
    assert not found.causes.changes
    assert worst < 5.0


def test_the_offsets_of_gyros_are_those_from_before_a_slip() -> None:
    noise = RowNoise.of_samples(SensorNoise(), 20, 1000.0)
    settings, rows = FitSettings(noise, PERIOD), made_up_rows(60)
    rows[:, 24:27] += 3.0 * noise.kinematics[0, :3]
    session = Session(len(POSES), 0, settings, replace(Guards(), misfit=1e-300, contradiction=1e-300, energy=1e9))
    for number, row in enumerate(rows):
        session.take(number, row)
    estimate, before = session.estimate, session._known.innovations
    assert estimate is not None
    slip = np.zeros(estimate.body.unknowns.size)
    slip[estimate.body.unknowns.poses[2]] = 0.1
    body = settings.body(estimate.state.moved(slip, estimate.body.unknowns, 6.0))
    after = replace(estimate, body=body)
    chapter = Chapter(RowBuffer(rows.shape[1], False), settings)
    kept, wrong = (Innovations(after, chapter, past).mean_residuals for past in (before.past_before_slip, before.past))
    assert np.abs(before.mean_residuals).max() > 1.0
    assert np.abs(kept - before.mean_residuals).max() < 0.2 * np.abs(wrong - before.mean_residuals).max()


def test_after_a_slip_of_a_leaking_load_what_the_leak_leaves_unknown_is_covered() -> None:
    poses, worst, found = slipped_poses(20.0, 1.0, 1, 3), 0.0, session()
    for number in range(420):
        load = LOAD - 0.05 * PERIOD * max(0, number - 150) * point_mass(np.array([-0.2, -0.1, 0.1]))
        found.take(number, made_up_rows(1, load, number, poses=POSES if number < 360 else poses)[0])
        if number > 365 and is_valid(found):
            worst = max(worst, mass_error(found, load[0]))
    assert [slip.robot for slip in found.causes.slips] == [1]
    assert 0.0 < worst < 5.0

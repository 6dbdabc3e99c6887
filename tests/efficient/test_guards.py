"""Each guard does something: with it a robot is right, or silent; without it, it is wrong, late, or silent for good."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import cache, cached_property

import numpy as np
import pytest

from coheft.agents.efficient.knowledge import Knowledge
from coheft.agents.efficient.session import Session
from coheft.agents.efficient.settings import Guards
from coheft.agents.efficient.stages import Stage
from coheft.app.faults.mutants import SWITCHED_OFF
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.moments.claims import claim_of
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.rows import FORCE, ROW_SIZE, TORQUE, A, RowNoise
from coheft.estimation.moments.sensor_errors import SensorErrors
from coheft.estimation.rigid_body.mass_properties import point_mass
from coheft.estimation.tolerance import SensorDrift
from tests.efficient import test_seal_guards
from tests.efficient.rows import LOAD, PERIOD, POSES, made_up_rows
from tests.efficient.sessions import AFTER, BEFORE, slipped_poses
from tests.efficient.sessions import slipped as one_slipped

SURE = 6.0
"""No number that is valid is further off, in its own standard deviations."""


@dataclass
class Case:
    """Rows, and what is true of what one robot makes of them.

    Attributes:
        rows: Makes those of the team.
        is_right: What must hold of the session and its history with the guard, and does not without it.
        loads: Makes true theta at each row, if not always ``LOAD``.
        told: The noise that robots are told, in units of the true one.
        own: Which robot.
        missing: Rows that never come.
        drift: Drift of torque sensors that robots are told [N·m per square root of a minute].
    """

    rows: Callable[[], Array]
    is_right: Callable[[Session, History], bool]
    loads: Callable[[], list[Array]] | None = None
    told: float = 1.0
    own: int = 0
    missing: range = range(0)
    drift: float = 0.0

    @cached_property
    def made(self) -> tuple[Array, list[Array]]:
        rows = self.rows()
        return rows, [LOAD] * len(rows) if self.loads is None else self.loads()

    def run(self, guards: Guards) -> tuple[Session, History]:
        noise = RowNoise.of_samples(SensorNoise().scaled(self.told), 20, 1000.0)
        settings = FitSettings(noise, PERIOD, torque_offset=self.drift, drift=SensorDrift(torque=self.drift))
        session = Session(len(POSES), self.own, settings, guards)
        history = History()
        rows, loads = self.made
        for number, row in enumerate(rows):
            if number in self.missing:
                continue
            session.take(number, row)
            is_clear = session.contradicting is None and not session.causes.is_open
            is_clear = is_clear and session.undeclared is None and session.suspected is None
            if session.stage is Stage.ESTIMATING and is_clear and session.is_confirmed:
                history.valid.append(number)
                history.errors.append(_error(session, self.own, loads[number]))
        return session, history


@dataclass
class History:
    """When what was known was valid, and how far it was off then at worst, in its own standard deviations."""

    valid: list[int] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)

    @property
    def is_sure(self) -> bool:
        return max(self.errors, default=0.0) < SURE


def _error(session: Session, own: int, load: Array) -> float:
    assert session.estimate is not None
    assert session.estimate.state.load is not None
    estimate = session.claimable(session.estimate)
    known, theta = claim_of(estimate, own).known, estimate.body.unknowns.theta
    errors = np.abs(session.estimate.state.load[6:] - load) / np.sqrt(estimate.covariance.diagonal()[theta])
    return float(errors[:known].max(initial=0.0))


def with_more(share: float) -> Array:
    """The load with so much more mass, at one point."""
    mass, position = share * LOAD[0], np.array([-0.2, -0.1, 0.1])
    return LOAD + mass * point_mass(position)


def off(first: int, end: int, count: int, robot: int, column: int, size: float) -> Array:
    """Rows of which one number of one robot is off for a time."""
    rows = made_up_rows(count)
    rows[first:end, ROW_SIZE * robot + column] += size
    return rows


@cache
def changed(share: float, before: int = 200, after: int = 100) -> tuple[Array, list[Array]]:
    """Rows over a change of the load, and the true loads."""
    load = with_more(share)
    rows = np.concatenate([made_up_rows(before), made_up_rows(after, load=load, first=before)])
    return rows, [LOAD] * before + [load] * after


@cache
def shifted(by: float, before: int = 200, after: int = 100, axis: int = 0) -> tuple[Array, list[Array]]:
    """Rows over a part of the load of 2 kg that shifts so far along an axis [m], and the true loads."""
    there = np.array([-0.35, -0.25, 0.02])
    load = LOAD + 2.0 * (point_mass(there + by * np.eye(3)[axis]) - point_mass(there))
    rows = np.concatenate([made_up_rows(before), made_up_rows(after, load=load, first=before)])
    return rows, [LOAD] * before + [load] * after


@cache
def leaking(rate: float, before: int = 150, after: int = 250) -> tuple[Array, list[Array]]:
    """Rows over a load that leaks [kg/s], and the true loads."""
    loads = [LOAD] * before + [with_more(-rate * PERIOD * number / LOAD[0]) for number in range(after)]
    parts = [made_up_rows(1, load=load, first=number) for number, load in enumerate(loads)]
    return np.concatenate(parts), loads


def slipped() -> Array:
    """Rows over grasps of two robots that slip by 5 cm at once."""
    aside = np.array([0.05, 0.0, 0.0])
    poses = (*POSES[:2], *(Pose(pose.rotation, pose.translation + aside) for pose in POSES[2:]))
    return np.concatenate([made_up_rows(150), made_up_rows(250, first=150, poses=poses)])


@cache
def turned_about_one_axis() -> tuple[Array, list[Array]]:
    """Rows over a change of a load that turns about one axis only, and the true loads: not all of any pose shows."""
    load, axes = with_more(0.008), (0.0, 0.0, 1.0)
    rows = np.concatenate([made_up_rows(100, axes=axes), made_up_rows(25, load, 100, axes=axes)])
    return rows, [LOAD] * 100 + [load] * 25


def slipped_a_little() -> Array:
    """Rows over a slip that is hidden in fits to rows from before and after it."""
    poses = slipped_poses(3.0, 0.2, 1, 5)
    return np.concatenate([made_up_rows(80, seed=5), made_up_rows(160, first=80, seed=5, poses=poses)])


def knocked() -> Array:
    """Rows over motion sensors of robot 1 that are turned by 0.35°: now and then they contradict the others."""
    poses, unmoved = slipped_poses(0.0, 0.35, 1, 1), made_up_rows(140, first=BEFORE)
    moved = made_up_rows(140, first=BEFORE, poses=poses)
    for column in (FORCE, TORQUE):
        own = slice(ROW_SIZE + column.start, ROW_SIZE + column.stop)
        moved[:, own] = unmoved[:, own]
    return np.concatenate([made_up_rows(BEFORE), moved])


def changed_in_a_gap() -> Array:
    """Rows over a small slip and another load while rows are missing, so that it is long doubtful what has changed."""
    heavier, poses = with_more(0.25), slipped_poses(8.0, 0.0, 3, 10)
    return np.concatenate([made_up_rows(BEFORE + 40), made_up_rows(AFTER, heavier, BEFORE + 40, poses=poses)])


def is_sure_after(then: History, row: int) -> bool:
    return all(error < SURE for number, error in zip(then.valid, then.errors, strict=True) if number > row)


CASES = {
    "surprise": Case(lambda: shifted(0.05)[0], lambda session, _: session.causes.changes[0].noticed < 203, own=3),
    "contradiction": Case(
        lambda: off(150, 170, 200, 1, A.start, 0.3), lambda _, then: not {*range(152, 170)} & {*then.valid}
    ),
    "lasting": Case(slipped, lambda session, then: then.valid[-1] > 390 and session.estimate is not None),
    "misfit": Case(
        lambda: off(8, 16, 200, 2, FORCE.start, 0.5), lambda _, then: then.is_sure and 40 < then.valid[0] < 60
    ),
    "energy": Case(lambda: made_up_rows(200), lambda _, then: then.valid[-1] < 199, told=0.8),
    "noise_tolerance": Case(lambda: made_up_rows(400), lambda _, then: len(then.valid) > 350, told=0.94),
    "offset": Case(lambda: off(200, 400, 400, 2, FORCE.start + 2, 0.5), lambda _, then: then.is_sure),
    "undeclared": Case(lambda: off(0, 400, 400, 2, FORCE.start, 0.25), lambda _, then: then.is_sure),
    "mass": Case(lambda: off(200, 350, 400, 2, TORQUE.start, 0.125), lambda _, then: then.is_sure),
    "undecided": Case(lambda: off(200, 350, 400, 2, TORQUE.start, 0.125), lambda _, then: then.is_sure),
    "mass_surprise": Case(
        lambda: changed(0.003)[0], lambda _, then: is_sure_after(then, 207), lambda: changed(0.003)[1], own=3
    ),
    "recent_step": Case(
        lambda: changed(0.006)[0], lambda _, then: is_sure_after(then, 205), lambda: changed(0.006)[1], own=3
    ),
    "small_step": Case(lambda: changed(0.002)[0], lambda _, then: is_sure_after(then, 216), lambda: changed(0.002)[1]),
    "shortest": Case(lambda: changed(0.003)[0], lambda _, then: is_sure_after(then, 207), lambda: changed(0.003)[1]),
    "small_step_fades": Case(
        lambda: leaking(0.004)[0], lambda _, then: max(then.errors) < 8.0, lambda: leaking(0.004)[1], drift=0.02
    ),
    "after_gap": Case(
        changed_in_a_gap, lambda _, then: then.valid[-1] > BEFORE + AFTER, missing=range(BEFORE, BEFORE + 40)
    ),
    "waiting": Case(
        lambda: shifted(0.05, after=60)[0],
        lambda _, then: then.is_sure,
        lambda: shifted(0.05)[1],
        missing=range(180, 210),
    ),
    "confirming": Case(
        lambda: shifted(0.018, after=20, axis=2)[0],
        lambda _, then: then.is_sure,
        lambda: shifted(0.018, after=20, axis=2)[1],
        missing=range(180, 210),
    ),
    "pose_step": Case(slipped_a_little, lambda session, _: [slip.robot for slip in session.causes.slips] == [1]),
    "turn": Case(lambda: shifted(0.003, before=300)[0], lambda session, _: session.causes.changes != []),
    "worth_a_fit": Case(
        lambda: turned_about_one_axis()[0], lambda _, then: is_sure_after(then, 107), lambda: turned_about_one_axis()[1]
    ),
    "undeclared_lasts": Case(lambda: off(0, 400, 480, 2, A.start, 0.009), lambda _, then: then.valid[-1] == 479),
    "undeclared_doubt": Case(lambda: off(60, 250, 250, 2, FORCE.start, 0.24), lambda _, then: then.is_sure),
    "calm": Case(knocked, lambda _, then: then.valid[-1] > 270),
    "drifting": Case(lambda: leaking(0.08)[0], lambda _, then: len(then.valid) > 340, lambda: leaking(0.08)[1]),
    "mistaken": Case(
        lambda: one_slipped(10.0, 0.0, 2, 2)[0], lambda session, _: [slip.robot for slip in session.causes.slips] == [2]
    ),
    "telling_apart": Case(
        lambda: shifted(0.004, after=200)[0],
        lambda session, then: session.causes.certain_changes != [] and then.valid[-1] > 380,
        lambda: shifted(0.004, after=200)[1],
    ),
}


@pytest.mark.parametrize("guard", CASES)
def test_a_guard_does_something(guard: str) -> None:
    case = CASES[guard]
    assert case.is_right(*case.run(Guards()))
    assert not case.is_right(*case.run(replace(Guards(), **{guard: SWITCHED_OFF[guard]})))


@dataclass(frozen=True)
class Work:
    """What a guard saves.

    Attributes:
        without: Value with which it saves nothing.
        step: Method of ``Knowledge`` that is called less often.
        errors: Standard deviations of sensor errors that robots are told.
    """

    without: float
    step: str = "fit"
    errors: dict[str, float] = field(default_factory=dict)


WORK = {
    "growth": Work(1.0),
    "growth_of_many": Work(Guards().growth, errors={"acceleration_scale": 0.003}),
    "undeclared_growth": Work(1.0, "undeclared_error"),
}


@pytest.mark.parametrize("guard", WORK)
def test_a_guard_saves_work(guard: str, monkeypatch: pytest.MonkeyPatch) -> None:
    work, calls = WORK[guard], list[None]()
    step = getattr(Knowledge, work.step)
    monkeypatch.setattr(Knowledge, work.step, lambda *args, **named: (calls.append(None), step(*args, **named))[1])
    settings = FitSettings(RowNoise.of_samples(SensorNoise(), 20, 1000.0), PERIOD, SensorErrors(work.errors))
    counts = list[int]()
    for guards in (Guards(), replace(Guards(), **{guard: work.without})):
        session = Session(len(POSES), 0, settings, guards)
        calls.clear()
        for number, row in enumerate(made_up_rows(400)):
            session.take(number, row)
        counts.append(len(calls))
    assert 0 < 1.5 * counts[0] < counts[1]


def test_for_every_guard_there_is_a_test_that_fails_without_it() -> None:
    assert {each.name for each in fields(Guards)} == {*SWITCHED_OFF, *WORK, *test_seal_guards.WITHOUT}


def test_a_change_that_another_robot_has_noticed_is_looked_for_at_once() -> None:
    rows, _ = shifted(0.005)
    settings = FitSettings(RowNoise.of_samples(SensorNoise(), 20, 1000.0), PERIOD)
    one, alone, told = (Session(len(POSES), own, settings, Guards()) for own in (2, 3, 3))
    for number, row in enumerate(rows):
        if one.causes.changes:
            told.look_closely_after(one.causes.changes[0].first, number)
        for session in (one, alone, told):
            session.take(number, row)
    noticed = [session.causes.changes[0].noticed for session in (one, alone, told)]
    assert noticed[2] <= noticed[0] + 2 < noticed[1]

"""A load that leaks stays known, and what is published covers that fits lag behind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from coheft.agents.efficient import load_drift
from coheft.agents.efficient.acceptance import UndeclaredWatch
from coheft.agents.efficient.causes import Causes
from coheft.agents.efficient.knowledge import Knowledge
from coheft.agents.efficient.load_drift import LoadChange, LoadDrift
from coheft.agents.efficient.session import Session
from coheft.agents.efficient.settings import Guards
from coheft.agents.efficient.slips import Suspicion
from coheft.agents.efficient.stages import Stage
from coheft.agents.efficient.unnoticed import Unnoticed
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.rows import FORCE, ROW_SIZE, RowNoise
from coheft.estimation.moments.undeclared import UndeclaredError
from coheft.estimation.moments.unknowns import THETA
from coheft.estimation.rigid_body.mass_properties import point_mass
from coheft.estimation.tolerance import SensorDrift
from tests.efficient.rows import LOAD, PERIOD, POSES, made_up_rows
from tests.efficient.sessions import AFTER, BEFORE, slipped

FROM, SETTLED = 150, 220
"""Rows from which on the load leaks, and from which on that is known."""
FIVE = 5.0


@dataclass(frozen=True, eq=False)
class Leak:
    """Rows of a load that leaks at one point, and the true loads (n, 10)."""

    rows: Array
    loads: Array

    @staticmethod
    def of(
        rate: float, count: int = 400, dropped_at: int | None = None, axes: tuple[float, ...] = (1.0, 1.0, 1.0)
    ) -> Leak:
        """A leak at this rate [kg/s]; another load of 1.6 kg may be dropped at a row. Loads turn about these axes."""
        leaked, dropped = point_mass(np.array([-0.2, -0.1, 0.1])), 1.6 * point_mass(np.array([-0.5, -0.5, 0.1]))
        ages = np.maximum(0, np.arange(count) - FROM) * PERIOD
        loads = LOAD - rate * ages[:, None] * leaked
        if dropped_at is not None:
            loads[dropped_at:] += dropped
        rows = [made_up_rows(1, load=load, first=row, axes=axes) for row, load in enumerate(loads)]
        return Leak(np.concatenate(rows), loads)


@dataclass(frozen=True)
class Followed:
    """What one robot makes of a leak from ``SETTLED`` on: the share of rows after which it has a valid estimate, and
    the share of these of which a number is off by more than five of its own standard deviations.
    """

    valid: float
    off: float


def session(torque_drift: float = 0.0) -> Session:
    noise = RowNoise.of_samples(SensorNoise(), 20, 1000.0)
    drift = SensorDrift(torque=torque_drift)
    return Session(len(POSES), 0, FitSettings(noise, PERIOD, torque_offset=torque_drift, drift=drift), Guards())


def after(rows: Array, torque_drift: float = 0.0) -> Session:
    """A robot that has taken these rows."""
    found = session(torque_drift)
    for number, row in enumerate(rows):
        found.take(number, row)
    return found


def in_deviations(found: Session, load: Array) -> float:
    """The largest error of what is published of the load, in its own standard deviations."""
    estimate = found.estimate
    assert estimate is not None
    assert estimate.state.load is not None
    variances = found.claimable(estimate).covariance.diagonal()[estimate.body.unknowns.theta]
    return float((np.abs(estimate.state.load[THETA] - load) / np.sqrt(variances)).max())


def follow(leak: Leak) -> Followed:
    found, worst = session(), list[float]()
    for number, (row, load) in enumerate(zip(leak.rows, leak.loads, strict=True)):
        found.take(number, row)
        is_sure = found.is_confirmed and not found.causes.is_open and found.suspected is None
        if number >= SETTLED and found.stage is Stage.ESTIMATING and is_sure:
            worst.append(in_deviations(found, load))
    return Followed(len(worst) / (len(leak.rows) - SETTLED), float(np.mean(np.array(worst) > FIVE)))


@cache
def slow() -> Leak:
    return Leak.of(0.05)


@cache
def fast() -> Leak:
    return Leak.of(0.1, count=500)


@cache
def very_fast() -> Leak:
    return Leak.of(0.2, count=500)


@pytest.mark.parametrize("leak", [slow, fast, very_fast])
def test_a_load_that_leaks_stays_known(leak: Callable[[], Leak]) -> None:
    found = follow(leak())
    assert found.valid > 0.95
    assert found.off == 0.0


def test_a_load_that_leaks_stays_known_although_poses_do_not_show() -> None:
    found = follow(Leak.of(0.1, axes=(0.0, 1.0, 0.0)))
    assert found.valid > 0.9
    assert found.off == 0.0


def test_what_is_published_covers_the_lag(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(load_drift, "_PUBLISHED", 0.0)
    assert follow(fast()).off > 0.005


@pytest.mark.parametrize(
    ("what", "name", "instead"),
    [
        (UndeclaredWatch, "dismiss", lambda *_: None),
        (Session, "suspected", property(lambda self: self._acceptance.undeclared.suspected)),
    ],
    ids=["dismissed", "hidden"],
)
def test_a_load_that_drifts_is_no_sensor_error(
    monkeypatch: pytest.MonkeyPatch, what: type, name: str, instead: object
) -> None:
    monkeypatch.setattr(what, name, instead)
    assert follow(Leak.of(0.05, count=500)).valid < 0.95


def test_a_load_stays_known_if_it_drifts_faster_than_a_change_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Session, "_drifts_on", lambda _: False)
    assert follow(fast()).valid < 0.95


def test_a_drift_goes_on_after_another_load(monkeypatch: pytest.MonkeyPatch) -> None:
    abrupt, load_drift = Leak.of(0.13, dropped_at=300), Causes.load_drift
    right = follow(abrupt)
    monkeypatch.setattr(Causes, "load_drift", lambda self, *args: load_drift(_Newest(self), *args))
    assert right.off < 0.02 < follow(abrupt).off


def test_a_slow_drift_goes_on_when_the_load_after_another_one_changes_again() -> None:
    assert follow(Leak.of(0.02, count=500, dropped_at=300)).off < 0.01  # the row in which it was dropped


class _Newest(Causes):
    """Causes that know only of the drift just before the newest change."""

    def __init__(self, whole: Causes) -> None:
        self._rows, self.changes, self.slips, self._forgotten = whole._rows, whole.changes[-2:], whole.slips, 0


@pytest.mark.parametrize(("share", "axis", "size"), [(0.3, 0, 1.0), (0.05, 2, 3.0)])
def test_a_faulty_sensor_after_a_load_change_is_no_drift(share: float, axis: int, size: float) -> None:
    load = LOAD + share * LOAD[0] * point_mass(np.array([-0.2, -0.1, 0.1]))
    rows = np.concatenate([made_up_rows(100), made_up_rows(60, load=load, first=100)])
    rows[150:, 2 * ROW_SIZE + FORCE.start + axis] += size
    assert after(rows).stage is not Stage.ESTIMATING


def two_steps(count: int, mass: float = 0.2) -> Array:
    """Rows of which the load becomes lighter by a mass [kg] at row 60 and again at row 110."""
    lost = mass * point_mass(np.array([-0.2, -0.1, 0.1]))
    parts = [made_up_rows(60), made_up_rows(50, LOAD - lost, first=60), made_up_rows(count, LOAD - 2 * lost, first=110)]
    return np.concatenate(parts)


def test_a_load_of_which_parts_are_taken_off_does_not_drift() -> None:
    found = after(two_steps(20, mass=1.0))
    assert [change.first for change in found.causes.changes] == [60, 110]
    assert found.load_drift is None
    assert after(two_steps(20)).load_drift is not None


def test_a_load_that_shifts_at_a_step_of_its_drift_has_changed_once() -> None:
    shifted = LOAD - 1.2 * point_mass(np.array([-0.2, -0.1, 0.1]))
    shifted[1] += 3.0  # eight kilograms by 0.4 m
    rows = np.concatenate([two_steps(40), made_up_rows(30, shifted, first=150)])
    assert [change.first for change in after(rows).causes.changes] == [60, 110, 150]


def test_an_offset_that_no_change_explains_is_no_step() -> None:
    rows = two_steps(70)
    rows[125:, 2 * ROW_SIZE + FORCE.start] += 0.8
    assert len(after(rows).causes.changes) == 2


def test_a_drift_that_does_not_go_on_is_over_although_sensors_drift() -> None:
    rows = two_steps(170)
    assert after(rows[:200], torque_drift=0.02).load_drift is not None
    assert after(rows, torque_drift=0.02).load_drift is None


def test_no_load_drifts_after_starting_over() -> None:
    found = after(two_steps(20))
    found._start_over()
    for number, row in enumerate(two_steps(70)[130:]):
        found.take(130 + number, row)
    assert found.stage is Stage.ESTIMATING
    assert found.load_drift is None


def test_an_error_that_was_suspected_before_a_drift_still_is() -> None:
    found = after(two_steps(60))
    found._acceptance.undeclared.suspected = error = UndeclaredError(1, "force_scale", 0.8)
    found._acceptance.undeclared.since = 80
    assert found.load_drift is not None
    assert found.suspected is None
    found._acceptance.undeclared.since = 50
    assert found.suspected == error
    found._acceptance.undeclared.dismiss(60)
    assert found.suspected == error


def test_another_team_is_told_how_far_off_a_leaking_load_may_be() -> None:
    leak = Leak.of(0.1, count=FROM + 100)
    former = after(leak.rows)
    assert former.load_drift is not None
    prior = former.hand_over(0.0)
    assert prior is not None
    found = Session(len(POSES), 0, former.settings, Guards(), prior)
    assert in_deviations(found, leak.loads[-1]) < FIVE


def test_another_team_is_told_of_a_change_that_has_not_been_noticed() -> None:
    leak = Leak.of(0.02, count=FROM + 60)
    former = after(leak.rows)
    assert not former.causes.changes
    prior = former.hand_over(0.0)
    assert prior is not None
    found = Session(len(POSES), 0, former.settings, Guards(), prior)
    assert in_deviations(found, leak.loads[-1]) < FIVE


def change(first: int, mass: float, abrupt: bool = False) -> LoadChange:
    return LoadChange(first, first + 5, mass / LOAD[0] * LOAD, 100.0 if abrupt else 1.0)


@pytest.mark.parametrize(
    ("changes", "mass", "longest", "expected"),
    [
        ([], 7.8, 100, None),
        ([change(100, 8.0)], 7.8, 100, None),
        ([change(100, 8.0), change(140, 7.9)], 7.8, 100, LoadDrift(-0.1, 40, 100)),
        ([change(10, 9.0), change(100, 8.0), change(140, 7.9)], 7.8, 100, LoadDrift(-0.1, 40, 100)),
        ([change(100, 8.0), change(140, 7.9)], 7.8, 39, None),
        ([change(100, 8.0), change(140, 7.9)], 7.4, 100, None),
        ([change(60, 8.1), change(100, 8.0), change(140, 7.9)], 7.4, 100, LoadDrift(-0.1, 40, 60)),
        ([change(60, 8.1), change(100, 8.0), change(140, 7.9, abrupt=True)], 9.0, 100, LoadDrift(-0.1, 40, 60)),
        (
            [change(60, 8.1), change(100, 8.0), change(140, 7.9, abrupt=True), change(160, 9.0)],
            8.9,
            100,
            LoadDrift(-0.1, 40, 100),
        ),
        ([change(100, 8.0, abrupt=True), change(140, 7.9)], 7.8, 100, None),
        ([change(20, 8.1), change(60, 8.0), *(change(row, 7.9, abrupt=True) for row in (100, 140))], 9.0, 100, None),
    ],
)
def test_a_drift_takes_two_similar_steps_in_a_short_time(
    changes: list[LoadChange], mass: float, longest: int, expected: LoadDrift | None
) -> None:
    found = LoadDrift.of(changes, mass, 170, longest)
    assert found == (expected if expected is None else expected._replace(step=pytest.approx(expected.step)))


@pytest.mark.parametrize(
    ("mass", "rows", "goes_on"),
    [(-0.1, 40, True), (-0.25, 40, True), (-0.35, 40, False), (0.1, 40, False), (-0.03, 40, False), (-0.1, 121, False)],
)
def test_a_drift_goes_on_alike_and_soon(mass: float, rows: int, goes_on: bool) -> None:
    assert LoadDrift(-0.1, 40, 0).goes_on(mass, rows) is goes_on


def test_what_is_published_stays_finite_if_rows_that_were_fitted_are_taken_back() -> None:
    found = after(two_steps(20))
    known, drift = found._known, found.load_drift
    known.fit()
    known.take_back(int(known.buffer.numbers[known.buffer.count - 1]) - 5)
    assert known.estimate is not None
    assert np.isfinite(Unnoticed(drift=drift).cover(known, known.estimate).covariance).all()


def test_a_load_that_is_to_be_confirmed_is_not_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    found = after(two_steps(30))
    known, estimate = found._known, found.estimate
    assert estimate is not None
    index = known.buffer.index_of(132)
    assert found.load_drift is not None
    monkeypatch.setattr(type(known), "follow_drift", lambda *_: True)
    assert found._follow_drift(index, estimate, 140)
    found.causes.changes.pop()
    found._detector.confirm(since=132)
    assert not found._follow_drift(index, estimate, 140)


def test_an_error_that_was_dismissed_has_to_be_found_twice_again(monkeypatch: pytest.MonkeyPatch) -> None:
    known, watch = after(made_up_rows(100))._known, UndeclaredWatch(doubt=0.6, growth=1.3, lasts=100)
    monkeypatch.setattr(Knowledge, "undeclared_error", lambda _: UndeclaredError(1, "force_scale", 1.5))
    assert not watch.test(known)
    watch.dismiss(watch.since)
    assert not watch.test(known)
    assert watch.test(known)


def test_a_drift_is_noticed_after_a_slip_that_robots_have_started_over_for() -> None:
    rows, poses = slipped(10.0, 0.0, 2, 2)
    loads = [LOAD - lost * point_mass(np.array([-0.2, -0.1, 0.1])) for lost in (0.2, 0.4)]
    parts = [made_up_rows(50, load, BEFORE + AFTER + 50 * step, poses=poses) for step, load in enumerate(loads)]
    found = session()
    for number, row in enumerate(np.concatenate([rows, *parts])):
        found.take(number, row)
        if len(found.causes.changes) == 1 and number < BEFORE + AFTER:
            found._start_over()
    assert [slip.robot for slip in found.causes.slips] == [2]
    assert len(found.causes.changes) == 2
    assert found.load_drift is not None


def test_a_leak_goes_on_while_rows_are_missing() -> None:
    found = after(two_steps(20))
    known, unnoticed = found._known, Unnoticed(drift=found.load_drift)
    assert unnoticed.drift is not None
    covered = []
    for gap in (0, 50):
        before = Suspicion.after_gap(known, known.buffer.number_at(known.buffer.count) + gap, 2, unnoticed, 0)._before
        assert before.unseen is not None
        mass = before.estimate.body.unknowns.theta.start
        covered.append(before.unseen[mass, mass])
    assert covered[1] > 2.0 * covered[0]

"""Sensors whose offsets wander, as robots are told."""

from __future__ import annotations

import msgspec
import pytest

from coheft.agents.efficient.load_drift import LoadDrift
from coheft.agents.efficient.session import Session
from coheft.agents.efficient.settings import Guards
from coheft.app.run.inprocess import run_in_process
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.rows import ROW_SIZE, RowNoise
from coheft.estimation.moments.sensor_errors import SensorErrors
from coheft.estimation.moments.unknowns import Unknowns
from coheft.estimation.tolerance import SensorDrift
from coheft.wire.messages.structs import Estimate
from coheft.wire.scenario.file import load_scenario
from tests.efficient.rows import LOAD, PERIOD, POSES, made_up_rows


def estimates(drift: SensorDrift, seed: int, duration: float) -> list[Estimate]:
    """What the first of three robots says."""
    shipped = load_scenario("real3")
    sensors = msgspec.structs.replace(shipped.sensors, drift=drift)
    scenario = msgspec.structs.replace(shipped, seed=seed, duration=duration, load_changes=(), sensors=sensors)
    return [record.estimates["r1"] for record in run_in_process(scenario) if "r1" in record.estimates]


def test_forces_that_wander_far_are_not_taken_for_another_load() -> None:
    assert estimates(SensorDrift(force=1.0), 605, 14.0)[-1].load_changes == []


@pytest.mark.slow
def test_what_wanders_is_no_contradiction() -> None:
    found = estimates(SensorDrift(force=0.3, acceleration=0.02), 602, 25.0)
    assert found[-1].load_changes == []
    late = [estimate.status == "valid" for estimate in found if estimate.time > 5.0]
    assert sum(late) / len(late) > 0.95
    payload = found[-1].payload
    assert payload is not None
    assert payload.covariance[0, 0] ** 0.5 < 0.05
    assert abs(payload.mass - 5.0) < 0.1


def test_a_gyro_that_wanders_fast_does_not_contradict_the_others() -> None:
    found = estimates(SensorDrift(gyro=0.024), 603, 9.0)
    late = [estimate.status == "valid" for estimate in found if estimate.time > 4.0]
    assert sum(late) / len(late) > 0.9


def drifting_session() -> Session:
    """A robot that has taken two seconds of rows, and knows that torque sensors drift."""
    noise = RowNoise.of_samples(SensorNoise(), 20, 1000.0)
    settings = FitSettings(noise, PERIOD, torque_offset=0.02, drift=SensorDrift(torque=0.02))
    session = Session(len(POSES), 0, settings, Guards())
    for number, row in enumerate(made_up_rows(100)):
        session.take(number, row)
    return session


def test_sensors_drift_before_another_team_begins() -> None:
    soon, late = drifting_session().hand_over(0.0), drifting_session().hand_over(60.0)
    assert soon is not None
    assert late is not None
    offset = Unknowns(len(POSES), SensorErrors()).offset
    known, less = (prior.evidence.information[offset, offset].diagonal()[3:] for prior in (soon, late))
    assert (less < 0.7 * known).all()


def test_sensors_drift_while_rows_are_missing() -> None:
    session = drifting_session()
    assert session.estimate is not None
    offset = session.estimate.body.unknowns.offset
    later = made_up_rows(40, first=3000)
    for number, row in enumerate(later, 3000):
        session.take(number, row)
    deviations = session.estimate.covariance[offset, offset].diagonal()[3:] ** 0.5
    whole = drifting_session()
    for number, row in enumerate(made_up_rows(40, first=100), 100):
        whole.take(number, row)
    assert whole.estimate is not None
    assert (deviations > 1.2 * whole.estimate.covariance[offset, offset].diagonal()[3:] ** 0.5).all()


def test_a_new_load_is_soon_fitted_to_more_rows_although_sensors_drift() -> None:
    session, load = drifting_session(), 1.3 * LOAD
    fits = set[float]()
    for number, row in enumerate(made_up_rows(60, load=load, first=100), 100):
        session.take(number, row)
        if session.causes.changes and session.estimate is not None and session.estimate.state.load is not None:
            fits.add(float(session.estimate.state.load[6]))
    assert len(session.causes.changes) == 1
    assert len(fits) > 4


def test_sensors_drift_while_rows_are_lost() -> None:
    """Rows that are lost one by one are no gap, but time passes."""
    pages = list[float]()
    for lost in (1, 2):
        session = drifting_session()
        for number, row in enumerate(made_up_rows(400, first=100)[::lost]):
            session.take(100 + lost * number, row)
        assert session.estimate is not None
        offset, prior = session.estimate.body.unknowns.offset, session._known._chapter.prior
        assert prior is not None
        pages.append(prior.evidence.information[offset, offset].diagonal()[3])
    assert pages[1] < 0.8 * pages[0]


def test_a_page_that_ends_just_after_a_step_of_a_leak_has_only_rows_of_the_present_load(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(LoadDrift, "goes_on", lambda *_: True)
    known = drifting_session()._known
    assert known.estimate is not None
    buffer, one = known.buffer, ROW_SIZE * len(POSES)
    assert known.follow_drift(known.estimate, buffer.count - 1, LoadDrift(-0.01, 20, 60))
    known.bridge(1.0)
    assert buffer.load_rows == buffer.moments()[1].sums(one)[one] == 1


def test_two_gaps_in_quick_succession_count_once_each() -> None:
    session, rows = drifting_session(), made_up_rows(10, first=200)
    known, begun = session._known, [session._known._pages._begun]
    for number, row in ((150, rows[0]), (169, rows[1])):
        session.take(number, row)
        begun.append(known._pages._begun)
    assert begun == sorted(begun)
    assert begun[-1] is not None
    known.buffer.take_back(0)
    assert known.buffer.count == 0
    known.bridge(2.0)
    assert known._pages._begun == begun[-1] + round(2.0 / PERIOD)

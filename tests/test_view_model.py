"""What the view shows, without any browser."""

from __future__ import annotations

import re

import msgspec
import numpy as np
import pytest

from coheft.app.results.judge import RobotReport
from coheft.app.results.record import SILENT
from coheft.app.view import words
from coheft.app.view.model import ViewModel
from coheft.app.view.replay import Timeline
from coheft.app.view.traces import WINDOW
from coheft.wire.messages.requests import RunState, Status
from coheft.wire.messages.structs import LoadChangeNotice, Problem, Validity
from coheft.wire.messages.truth import LoadState
from coheft.wire.scenario.network import LinkQuality
from tests.synthetic_run import BLOCK, HEAVY, LIGHT, ROBOTS, SCENE, STD, changing_run, estimate, truth

STATUS = Status(
    scenario="three",
    state=RunState.RUNNING,
    block=0,
    time=0.0,
    duration=4.0,
    real_time_factor=1.0,
    late_blocks=0,
    loads=[],
    slots_free=4,
    waiting_for=[],
    estimator="efficient",
    estimators=["efficient", "fan2017"],
    scene=SCENE,
)


def news_of_a_change():
    truths, estimates = changing_run({"r1": 110, "r2": 120, "r3": 130}, {"r1": 2.1, "r2": 2.2})
    news = [(t.time, t) for t in truths] + [(e.time, e) for series in estimates.values() for e in series]
    return sorted(news, key=lambda item: item[0])


def report_of(model: ViewModel, robot: str) -> RobotReport | None:
    found = model.reports(robot)[STATUS.estimator]
    return None if found is None else found[0]


def test_numbers_are_those_of_the_report():
    model = ViewModel(STATUS)
    model.receive(truth(0, LIGHT))
    model.receive(estimate("r1", 0, HEAVY))
    report = report_of(model, "r1")
    assert report is not None
    assert (report.mass.truth, report.mass.estimate, report.mass.std) == (10.0, pytest.approx(13.0), STD[0])
    believed = model.believed_payload("r1")
    assert believed is not None
    np.testing.assert_allclose(believed.com, HEAVY.com, atol=1e-12)
    np.testing.assert_allclose(believed.tensor, HEAVY.tensor, atol=1e-12)
    assert report_of(model, "r2") is None
    assert model.believed_payload("r2") is None


def test_an_estimate_waits_for_its_truth():
    model = ViewModel(STATUS)
    model.receive(estimate("r1", 3, HEAVY))
    assert report_of(model, "r1") is None
    model.receive(truth(3, HEAVY))
    report = report_of(model, "r1")
    assert report is not None
    assert report.mass.error_pct == pytest.approx(0.0)


def test_a_link_is_as_good_as_its_worse_end_says():
    model = ViewModel(STATUS)
    assert model.edges == [("r1", "r2"), ("r2", "r3")]
    assert model.link(("r1", "r2")) == "unknown"
    for name in ROBOTS:
        model.receive(estimate(name, 0, None))
    assert model.link(("r1", "r2")) == "up"
    model.receive(msgspec.structs.replace(estimate("r2", 1, None), silent=["r1"]))
    assert model.link(("r1", "r2")) == "silent"
    assert model.link(("r2", "r3")) == "up"
    model.receive(truth(SILENT + 2, LIGHT))
    assert model.link(("r2", "r3")) == "unknown", "neither end has said anything for long"
    assert model.record.beliefs["r3"].status == "stale"


def test_curves_show_errors_in_their_own_band_and_look_back_so_far():
    model = ViewModel(STATUS)
    last = round((WINDOW + 5.0) / BLOCK)
    for block in range(0, last, 50):
        model.receive(truth(block, LIGHT))
        model.receive(estimate("r1", block, HEAVY if block > last / 2 else None))
    curves = model.traces["r1"][STATUS.estimator].curves()
    assert curves["mass"].times[0] >= model.record.time - WINDOW
    assert np.isnan(curves["mass"].errors[0, 0])
    assert curves["mass"].errors[0, -1] == pytest.approx(3.0)
    assert curves["mass"].band[-1] == pytest.approx(3.0 * STD[0])
    assert curves["com"].band[-1] == pytest.approx(3e3 * STD[1:4].max())
    assert curves["inertia"].band[-1] == pytest.approx(3.0 * STD[4:7].max())
    assert curves["mass"].limit > 3.0
    assert model.traces["r2"][STATUS.estimator].curves()["mass"].limit == 1.0


def test_a_jump_in_a_recording_shows_what_playing_it_shows():
    played, jumped = Timeline(STATUS, news_of_a_change()), Timeline(STATUS, news_of_a_change())
    for time in np.arange(0.0, 3.0, 0.1):
        played.seek(float(time))
    played.seek(3.0)
    jumped.seek(4.0)
    jumped.seek(3.0)
    there, back = played.model, jumped.model
    assert back.record.time == there.record.time == pytest.approx(3.0)
    for name in ROBOTS:
        assert report_of(back, name) == report_of(there, name)
    assert played.end == pytest.approx(4.0)


def test_a_recording_knows_whether_it_plays():
    timeline = Timeline(STATUS, news_of_a_change())
    timeline.note_playing(True)
    assert timeline.model.status.state == "running"
    timeline.note_playing(False)
    assert timeline.model.status.state == "paused"
    timeline.seek(timeline.end)
    timeline.note_playing(False)
    assert timeline.model.status.state == "finished"


def test_texts_tell_numbers_reasons_and_changes_and_let_nobody_write_html():
    model = ViewModel(STATUS)
    assert "no data yet" in words.header(model)
    assert "No estimate from this robot" in words.belief(None)
    change = LoadChangeNotice(noticed_at=1.5, changed_at=1.4)
    said = estimate("r1", 0, HEAVY, changes=[change])
    model.receive(truth(0, LIGHT))
    model.receive(msgspec.structs.replace(said, status=Validity.STALE, reasons=["<b>r2</b> is silent"]))
    model.receive(Problem(source="r1", text="refused <script>"))
    text = words.belief(model.reports("r1")[STATUS.estimator])
    assert "10.000" in text
    assert "13.000" in text
    assert "1.50 s" in text
    assert "&lt;b&gt;r2" in text
    assert "&lt;script&gt;" in words.problems(model)
    assert "stale" in words.team(model, "r1")
    assert "mass, kg" in words.team(model, "r1"), "a number has a unit"
    paused = msgspec.structs.replace(STATUS, state=RunState.PAUSED)
    assert "resume" in words.waiting_note(paused, is_still=False).lower()
    waits = msgspec.structs.replace(STATUS, state=RunState.RUNNING, waiting_for=["r1"])
    assert [words.waiting_note(waits, is_still=is_still) for is_still in (False, True)] == ["", "waiting for r1"]


def test_a_load_that_is_dropped_while_time_stands_still_is_there_at_once() -> None:
    model = ViewModel(STATUS)
    model.receive(truth(0, LIGHT))
    before = model.changes
    dropped = LoadState(1, 3.0, (0.0, 0.0, 0.1), (0.1, 0.1, 0.1))
    model.note_status(msgspec.structs.replace(STATUS, state=RunState.PAUSED, block=1, loads=[dropped]))
    assert model.loads == [dropped]
    assert model.changes > before, "there is another picture to draw"
    model.note_status(msgspec.structs.replace(STATUS, state=RunState.RUNNING, block=1, loads=[dropped]))
    assert model.loads == [dropped], "until the first truth after the pause"
    model.receive(truth(1, LIGHT))
    assert model.loads == [], "while time runs, the newest truth tells"


def test_numbers_have_as_many_digits_as_their_std_says_something_about() -> None:
    said = estimate("r1", 0, LIGHT)
    assert said.payload is not None
    sure = msgspec.structs.replace(said.payload, covariance=1e-10 * said.payload.covariance)
    model = ViewModel(STATUS)
    model.receive(truth(0, LIGHT))
    model.receive(msgspec.structs.replace(said, payload=sure))
    for text in (words.team(model, "r1"), words.belief(model.reports("r1")[STATUS.estimator])):
        assert not re.search(r">(± )?0\.0+<", text), text


def test_what_the_operator_has_disturbed_is_shown_until_it_is_restored() -> None:
    model, lossy = ViewModel(STATUS), LinkQuality(loss=0.2)
    assert words.disturbances(model) == ""
    model.receive(msgspec.structs.replace(truth(0, LIGHT), clocks={"r2": 0.003}))
    for name, disturbed in (
        ("r1", {"r2": lossy}),
        ("r2", {"r1": lossy}),
        ("r3", {"r2": LinkQuality(delay=0.1)}),
    ):
        model.receive(msgspec.structs.replace(estimate(name, 0, LIGHT), disturbed=disturbed))
    text = words.disturbances(model)
    for line in (
        "r1-r2: 20 % lost",
        "r2 to r3: 0.1 s late",
        "clock of r2: 0.003 s ahead",
    ):
        assert f"<div>{line}</div>" in text
    model.receive(estimate("r1", 1, LIGHT))
    assert LinkQuality(0.2, 0.1, 0.2).in_words == "20 % lost, others 0.1 to 0.3 s late"
    assert "r1 to r2: 20 %" in words.disturbances(model), "r1 receives everything in time, and r2 does not"
    model.receive(truth(1, LIGHT))
    model.receive(estimate("r2", 1, LIGHT))
    assert list(model.disturbances) == [("r2", "r3")]

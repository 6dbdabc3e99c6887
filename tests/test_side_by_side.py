"""Estimators that run side by side in every robot, on the same samples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from functools import partial
from io import StringIO
from pathlib import Path

import msgspec
import numpy as np
import pytest
from rich.console import Console

import coheft
from coheft.agents.estimator import Belief, Channels
from coheft.agents.side_by_side import SideBySide
from coheft.api.tracks import RobotResult, Track
from coheft.app.figures import LIGHT as LIGHT_THEME
from coheft.app.figures import figure_to
from coheft.app.results.judge import Contradiction
from coheft.app.results.record import Record
from coheft.app.results.report import BoundReport
from coheft.app.run_report.convergence import ALL_SHOWN, curves, draw_convergence
from coheft.app.run_report.data import write_data
from coheft.app.run_report.drawings import draw_overview
from coheft.app.run_report.series import SeriesFollower
from coheft.app.study.bounds import with_bound
from coheft.app.study.samples import simulate, with_exact_sensors
from coheft.app.study.trial import Moments, run_trial
from coheft.app.terminal.final_table import headings, print_report, table_rows
from coheft.app.terminal.screen import LiveDisplay
from coheft.app.view import words
from coheft.app.view.model import ViewModel
from coheft.errors import CoheftError, PluginError, ScenarioError
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import MeasurementBlock
from coheft.wire.config import agent_config
from coheft.wire.former_names import present
from coheft.wire.messages.size import largest_message
from coheft.wire.messages.structs import EstimateBeside
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import LoadChange
from tests.synthetic_run import HEAVY, LIGHT, SCENE, estimate, truth
from tests.test_view_model import STATUS

BOTH = "efficient,fan2017"
SECONDS = 6.0


@pytest.fixture(scope="module")
def both() -> coheft.Result:
    """A run with both estimators."""
    return coheft.run("ring3", duration=SECONDS, estimator=BOTH)


def assert_same(one: RobotResult, other: RobotResult) -> None:
    """Check that two robots published the same estimates, bit for bit."""
    for name in ("time", "state", "valid", "converged", "noticed"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    for name in ("mass", "com", "inertia"):
        for part in fields(Track):
            found, expected = (getattr(getattr(robot, name), part.name) for robot in (one, other))
            assert np.array_equal(found, expected, equal_nan=True), f"{name}.{part.name}"


@pytest.mark.parametrize("estimator", ["efficient", "fan2017"])
def test_each_gives_what_it_gives_alone_bit_for_bit(both: coheft.Result, estimator: str) -> None:
    alone = coheft.run("ring3", duration=SECONDS, estimator=estimator)
    found = both if estimator == "efficient" else both.beside[estimator]
    assert found.report.estimator == estimator
    assert found.report.robots == alone.report.robots
    for name, robot in alone.robots.items():
        assert robot.valid.any()
        assert_same(found.robots[name], robot)


def test_either_can_be_the_robots_own(both: coheft.Result) -> None:
    swapped = coheft.run("ring3", duration=SECONDS, estimator="fan2017, efficient")
    assert swapped.report.estimator == "fan2017"
    assert swapped.report.robots == both.beside["fan2017"].report.robots
    assert swapped.beside["efficient"].report.robots == both.report.robots


def test_table_and_json_show_both_beside_the_bound(both: coheft.Result) -> None:
    printed = StringIO()
    console = Console(width=100, file=printed)
    print_report(console, both.report, folder=Path())
    text = printed.getvalue()
    assert "s, efficient, fan2017)" in text
    assert "fan2017: Not converged: " in text
    own, beside = table_rows(both.report)["r1"][:2]
    assert (own[0], own[2], beside[0], beside[2]) == ("mass, kg", "efficient", "", "fan2017")
    assert len(own) == len(headings(both.report)) - 1
    assert own[-1].endswith(" %")
    report = msgspec.json.decode(msgspec.json.encode(both.report))
    assert report["beside"]["fan2017"]["robots"]["r1"]["mass"] != report["robots"]["r1"]["mass"]
    assert report["bound"].keys() == report["robots"].keys()


@pytest.mark.parametrize("is_terminal", [False, True])
@pytest.mark.parametrize("ratio", [None, 57.2])
def test_the_table_of_both_is_stacked_in_80_columns(
    both: coheft.Result, ratio: float | None, *, is_terminal: bool
) -> None:
    """Even with the ratio that follows the std of an error that is too large."""
    report = both.report
    if ratio is not None:
        robots = {
            name: msgspec.structs.replace(robot, contradictions=[Contradiction("centre of mass", ratio)])
            for name, robot in report.robots.items()
        }
        report = msgspec.structs.replace(report, robots=robots)
    printed = StringIO()
    console = Console(width=80, file=printed, force_terminal=is_terminal, color_system=None)
    print_report(console, report, folder=Path())
    lines = printed.getvalue().splitlines()
    assert max(map(len, lines)) <= 80
    headings, mass, *beside = [line.split() for line in lines[2:13]]
    assert headings == ["robot", "quantity", "truth", "/", "estimate", "error", "own", "std", "bound"]
    assert mass[:4] == ["r1", "mass,", "kg", "5.000"]
    assert [cells[0] for cells in beside] == [
        *BOTH.split(","),
        "centre",
        *BOTH.split(","),
        "inertia,",
        *BOTH.split(","),
        "r2",
    ]
    assert ("(57.2×)" in beside[3]) == (ratio is not None)


def test_the_table_of_a_run_in_progress_has_a_line_for_each_in_80_columns() -> None:
    console = Console(width=80, height=24, file=StringIO(), force_terminal=True, color_system=None)
    record = Record(SCENE, 20.0, BOTH)
    record.receive(truth(9, HEAVY))
    for name in SCENE.robots:
        own = msgspec.structs.replace(estimate(name, 9, HEAVY), estimator="efficient")
        record.receive(own)
        record.receive(EstimateBeside(msgspec.structs.replace(own, estimator="fan2017")))
    with LiveDisplay(console) as display:
        display.begin(msgspec.structs.replace(STATUS, estimator=BOTH))
        display.update(record)
    assert isinstance(console.file, StringIO)
    text = console.file.getvalue()
    assert "robots, estimators efficient and fan2017, side by side\n" in text
    assert "r1         converged" in text
    assert "r1 fan2017 converged" in text


def test_bounds_have_the_digits_of_std(both: coheft.Result) -> None:
    bound = {name: BoundReport(0.0202, 151.7, 1.0) for name in both.report.robots}
    rows = table_rows(msgspec.structs.replace(both.report, bound=bound))["r1"]
    assert [row[-1] for row in rows[::2]] == ["0.020 %", "152 mm", "1.0 %"]


def test_the_bound_is_that_of_a_study(both: coheft.Result) -> None:
    full = run_trial(both.scenario, [], Moments((SECONDS,), None, 1.0)).full[0].payload
    assert both.report.bound is not None
    masses = np.sqrt(full[:, 0, 0]) / both.report.robots["r1"].mass.truth
    np.testing.assert_allclose([each.mass_pct for each in both.report.bound.values()], 100.0 * masses)
    centres = np.sqrt(np.trace(full[:, 1:4, 1:4], axis1=1, axis2=2))
    np.testing.assert_allclose([each.com_mm for each in both.report.bound.values()], 1e3 * centres)


def test_a_bound_knows_of_load_changes_that_the_scenario_says_and_of_no_others(both: coheft.Result) -> None:
    load = LoadChange(at=3.0, mass=2.0, position=(0.1, 0.0, 0.0))
    heavier = msgspec.structs.replace(both.scenario, load_changes=(load,))
    last = simulate(with_exact_sensors(heavier)).truths[-1]
    unbound = msgspec.structs.replace(both.report, bound=None)
    assert with_bound(unbound, both.scenario, last).bound is None
    found, expected = with_bound(unbound, heavier, last).bound, run_trial(heavier, [], Moments((2.0,), 3.0, 3.0))
    assert found is not None
    assert expected.recovery_bound is not None
    centres = np.sqrt(np.trace(expected.recovery_bound.payload[:, 1:4, 1:4], axis1=1, axis2=2))
    np.testing.assert_allclose([each.com_mm for each in found.values()], 1e3 * centres)


def test_the_page_shows_curves_of_both_by_name(both: coheft.Result, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    pytest.importorskip("jinja2")
    follower = SeriesFollower()
    follower.begin(msgspec.structs.replace(STATUS, estimator=BOTH))
    for block in range(3):
        follower.receive(truth(block, LIGHT))
        follower.receive(estimate("r1", block, LIGHT))
        follower.receive(EstimateBeside(msgspec.structs.replace(estimate("r1", block, HEAVY), estimator="fan2017")))
    series = follower.series
    own, beside = (curves(series, "r1", ALL_SHOWN[0], name)[0] for name in series.by_estimator)
    assert (list(own.error), list(beside.error)) == ([0.0] * 3, [pytest.approx(3000.0)] * 3)
    for draw in (draw_overview, partial(draw_convergence, shown=ALL_SHOWN[0])):
        with figure_to(tmp_path / "picture.svg", 10.0, 4.0, LIGHT_THEME) as figure:
            draw(figure, LIGHT_THEME, series, both.report)
            texts = {text.get_text() for axes in figure.axes for text in [axes.title, *axes.texts]}
            texts |= {axes.get_title(loc="left") for axes in figure.axes}
            texts |= {label for axes in figure.axes for label in axes.get_legend_handles_labels()[1]}
        assert {"efficient", "fan2017"} <= texts
    (file,) = [file for file in write_data(series, tmp_path) if file.stem == "estimates"]
    assert file.is_file()


def test_either_can_be_exported_and_its_name_is_said(both: coheft.Result, tmp_path: Path) -> None:
    path = tmp_path / "both.json"
    path.write_bytes(msgspec.json.encode(both.report))
    own, beside = coheft.export(path, "urdf"), coheft.export(path, "urdf", estimator="fan2017")
    assert "estimator efficient" in own
    assert "estimator fan2017" in beside
    assert coheft.export(both, "mjcf", estimator="seed") != coheft.export(both, "mjcf")
    with pytest.raises(CoheftError, match=r"the estimator mine did not run: there are results of efficient, fan2017"):
        coheft.export(both, "urdf", estimator="mine")


def test_messages_have_room_for_both() -> None:
    ring = load_scenario("ring6")
    sizes = {name: largest_message(msgspec.structs.replace(ring, estimator=name)) for name in ("efficient", "fan2017")}
    together = largest_message(msgspec.structs.replace(ring, estimator=BOTH))
    assert max(sizes.values()) < together < sum(sizes.values())


def test_a_wrong_or_repeated_name_is_refused() -> None:
    with pytest.raises(ScenarioError, match=r"found 'fan201', expected one of: efficient, fan2017\. Did you mean"):
        coheft.simulate("ring3", estimator="efficient,fan201")
    with pytest.raises(ScenarioError, match=r"found 'efficient' twice, expected different estimators"):
        coheft.simulate("ring3", estimator="efficient,efficient")
    with pytest.raises(ScenarioError, match=r"found 'fan2017' twice"):
        coheft.simulate("ring3", estimator="fan2017,seed")
    with pytest.raises(ScenarioError, match=r"key 'carry'"):
        coheft.simulate("carry6", estimator="fan2017,efficient")


def test_former_names_are_read_in_a_list() -> None:
    assert present("efficient, seed") == "efficient,fan2017"


def test_settings_of_each_reach_it() -> None:
    ring = load_scenario("ring3")
    with_settings = msgspec.structs.replace(ring, estimator="efficient,mine", settings={"mine": {"gain": 2.0}})
    config = agent_config(with_settings, "r1", ("r2", "r3"))
    assert config.estimator_settings == {"efficient": {}, "mine": {"gain": 2.0}}


class Counter:
    """Sends its count of steps, and fails at a given step."""

    def __init__(self, fails_at: int = 10**9) -> None:
        self.steps, self.heard = 0, list[float]()
        self._fails_at = fails_at

    def step(self, index: int, own: MeasurementBlock | None, inbox: Mapping[str, Channels]) -> dict[str, Array]:
        if index >= self._fails_at:
            raise PluginError("it has run out of numbers")
        self.steps += 1
        self.heard += [float(channels["count"][0]) for channels in inbox.values()]
        return {"count": np.array([float(self.steps)])}

    def fits(self, channels: Channels) -> bool:
        return channels.keys() == {"count"}

    def belief(self) -> Belief:
        return Belief("inertia", converged=False, payload=None, poses={}, learned_block=self.steps)

    def doubts(self) -> tuple[str, ...]:
        return ()


@pytest.mark.parametrize("failing", ["one", "two"])
def test_if_one_fails_the_other_continues_and_says_so(failing: str) -> None:
    made = {name: Counter(fails_at=2 if name == failing else 10**9) for name in ("one", "two")}
    pair = SideBySide(made)
    for index in range(5):
        sent = pair.step(index, None, {})
    (other,) = made.keys() - {failing}
    assert made[other].steps == 5
    assert sent.keys() == {f"{other}/count"}
    assert pair.doubts_of(failing) == ("it has run out of numbers",)
    assert pair.belief_of(failing).payload is None
    assert pair.doubts_of(other) == ()
    assert pair.belief_of(other).learned_block == 5


def test_each_hears_only_its_own_arrays_that_it_can_read() -> None:
    made = {"one": Counter(), "two": Counter()}
    pair = SideBySide(made)
    message = {"one/count": np.array([7.0]), "two/other": np.array([8.0])}
    assert pair.fits(message)
    pair.step(0, None, {"r2": message})
    assert (made["one"].heard, made["two"].heard) == ([7.0], [])
    assert not pair.fits({"count": np.array([7.0])}), "of a robot that runs one estimator alone"


def test_the_view_shows_both() -> None:
    model = ViewModel(msgspec.structs.replace(STATUS, estimator=BOTH))
    model.receive(truth(0, LIGHT))
    model.receive(estimate("r1", 0, LIGHT))
    model.receive(EstimateBeside(msgspec.structs.replace(estimate("r1", 0, HEAVY), estimator="fan2017")))
    own, beside = (None if found is None else found[0] for found in model.reports("r1").values())
    assert own is not None
    assert beside is not None
    assert (own.mass.estimate, beside.mass.estimate) == (pytest.approx(10.0), pytest.approx(13.0))
    text = words.beliefs(model, "r1")
    assert text.index("efficient") < text.index("10.0") < text.index("fan2017") < text.index("13.0")
    masses = {name: trace.curves()["mass"].errors[0, -1] for name, trace in model.traces["r1"].items()}
    assert masses == {"efficient": pytest.approx(0.0), "fan2017": pytest.approx(3.0)}

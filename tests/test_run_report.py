"""The page about a run, made from a run of two robots in this process, with a change of the load."""

from __future__ import annotations

import base64
import csv
import dataclasses
import io
import json
import re
import shutil
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pytest

from coheft.app.figures import LIGHT, figure_to, picture_folder
from coheft.app.results.judge import Contradiction
from coheft.app.results.record import Record
from coheft.app.results.report import Report, build_report
from coheft.app.results.states import State
from coheft.app.run.inprocess import run_in_process
from coheft.app.run_report import data, folder
from coheft.app.run_report.convergence import ALL_SHOWN, curves
from coheft.app.run_report.drawings import draw_overview, pictures_of
from coheft.app.run_report.folder import write_folder
from coheft.app.run_report.page import SECTIONS, render_page
from coheft.app.run_report.series import Series, SeriesFollower, Span, Thinned, add_span
from coheft.app.terminal.digits import error_and_std
from coheft.consensus.graph import build_graph
from coheft.errors import CoheftError
from coheft.physics_server.simulation import Simulation
from coheft.wire.messages.requests import RunState, Status
from coheft.wire.messages.structs import Problem
from coheft.wire.scenario.file import parse_scenario
from coheft.wire.scenario.schema import Graph, Scenario
from tests.synthetic_run import HEAVY, estimate

pytest.importorskip("matplotlib")
pytest.importorskip("jinja2")

SCENARIO = """
name = "two"
duration = 7.0
payload.boxes = [{ mass = 6.0, size = [0.8, 0.3, 0.1], position = [0.1, 0.0, 0.02] }]
robots.grasps = [{ position = [-0.4, 0.0, 0.0] }, { position = [0.4, 0.0, 0.0], rotation_deg = [0, 0, 180] }]
graph.kind = "line"

[[load_changes]]
at = 4.0
mass = 1.0
position = [0.1, 0.0, 0.1]
"""
TABLES = {"estimates", "poses", "states", "load-changes", "pace"}


class Page(HTMLParser):
    """What a browser would make of the page."""

    VOID = ("meta", "img", "source", "br", "link", "input")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.images: list[str] = []
        self.words = ""
        self.cells: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in self.VOID:
            self.open.append(tag)
        if tag in ("td", "th"):
            self.cells.append("")
        for name, value in attrs:
            if name == "id":
                self.ids.append(value or "")
            elif name == "href":
                self.links.append(value or "")
            elif name in ("src", "srcset"):
                self.images.append(value or "")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, text: str) -> None:
        self.words += text
        if self.open and self.open[-1] in ("td", "th"):
            self.cells[-1] += text


class Made:
    """A run and what was written about it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.scenario: Scenario = parse_scenario(SCENARIO, "two")
        graph = build_graph(self.scenario.graph, self.scenario.robot_names)
        scene = Simulation(self.scenario, graph).scene
        self.status = status = Status(
            scenario="two",
            state=RunState.RUNNING, block=0, time=0.0, duration=7.0, real_time_factor=1.0, late_blocks=0,
            loads=[], slots_free=4, waiting_for=[], estimator="efficient",
            estimators=["efficient", "fan2017"], scene=scene,
        )  # fmt: skip
        follower, record = SeriesFollower(), Record(scene, self.scenario.duration)
        follower.begin(status)
        for block in run_in_process(self.scenario):
            for news in (*block.estimates.values(), block.truth):  # the truth last: estimates have to wait for it
                follower.receive(news)
                record.receive(news)
        follower.receive(Problem(source="r1", text="refused <b>nonsense</b>"))
        follower.end(status)
        self.series: Series = follower.series
        self.report: Report = build_report(self.scenario, record, real_time_factor=2.5)
        folder.mkdir(parents=True)
        self.text = write_folder(folder, self.scenario, "lockstep", self.series, self.report).read_text()
        self.page = Page(self.text)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return Made(tmp_path_factory.mktemp("made") / "new" / "report")


@pytest.mark.slow
def test_the_page_is_whole_and_every_link_of_the_contents_leads_somewhere(made: Made) -> None:
    assert made.page.open == []
    assert len(set(made.page.ids)) == len(made.page.ids)
    assert made.page.links == [f"#{name}" for name in SECTIONS]
    assert {link[1:] for link in made.page.links} <= set(made.page.ids)


def test_the_page_is_not_good_above_an_error_that_its_std_rules_out(made: Made) -> None:
    def verdicts(report: Report) -> list[str]:
        page = render_page(made.scenario, "lockstep", made.series, report, [], [])
        return re.findall(r'<p class="verdict (.*)</p>', page)

    robots = dict(made.report.robots)
    robots = {name: msgspec.structs.replace(robot, contradictions=[]) for name, robot in robots.items()}
    good = msgspec.structs.replace(made.report, robots=robots)
    assert verdicts(good) == ['good">Every robot converged']
    robots["r1"] = msgspec.structs.replace(robots["r1"], contradictions=[Contradiction("mass", 4.1)])
    bad = msgspec.structs.replace(made.report, robots=robots)
    assert verdicts(bad) == ['bad">Further off than they claim: r1']


def test_numbers_stand_on_the_right_of_their_columns_and_words_on_the_left(made: Made) -> None:
    report = msgspec.structs.replace(made.report, beside={"fan2017": made.report})
    page = render_page(made.scenario, "lockstep", made.series, report, [], [])
    headings = re.findall(r'<th scope="col"( class="number")?>(robot|truth|estimator|estimate|own std)</th>', page)
    is_number = {name: bool(number) for number, name in headings}
    assert is_number == {"robot": False, "truth": True, "estimator": False, "estimate": True, "own std": True}
    for name in ("efficient", "fan2017"):
        assert page.count(f'<td>{name}</td><td class="number">') == 6


def test_the_page_tells_what_was_run(made: Made) -> None:
    scenario = msgspec.structs.replace(made.scenario, graph=Graph(kind="complete"), estimator="efficient,fan2017")
    page = render_page(scenario, "lockstep", made.series, made.report, [], [])
    pairs = dict(re.findall(r"<dt>([^<]*)</dt><dd>([^<]*)</dd>", page))
    assert (pairs["robots"], pairs["links between them"], pairs["estimator"]) == ("2", "complete", "efficient,fan2017")


def test_the_page_needs_nothing_but_itself(made: Made) -> None:
    assert all(image.startswith("data:image/png;base64,") for image in made.page.images)
    without_images = re.sub(r"data:image/png;base64,[A-Za-z0-9+/=]*", "", made.text)
    assert not re.search(r"https?:|//|@import|url\(|<script[^>]*\bsrc|<link|\bfetch\(|\bimport\(", without_images)


def test_every_picture_is_in_the_page_and_beside_it(made: Made) -> None:
    pictures = pictures_of(made.series, made.report)
    names = [picture.name for picture in pictures]
    assert {"mass", "centre-of-mass", "inertia", "pose-rotation", "pose-translation"} <= set(names)
    assert {"load-changes", "consensus", "observability", "pace"} <= set(names)
    assert {path.stem for path in made.folder.glob("*.png")} == set(names)
    assert {f"figure-{name}" for name in names} <= set(made.page.ids)
    embedded = [base64.b64decode(image.partition(",")[2]) for image in made.page.images]
    assert len(embedded) == 2 * len(names), "on light and on dark paper"
    assert all((made.folder / f"{name}.png").read_bytes() in embedded for name in names)
    of_errors = [picture for picture in pictures if picture.section == "errors"]
    assert made.page.words.count("The error was inside the band in") == len(of_errors) == 5


def test_the_numbers_are_those_of_the_report_for_programs(made: Made) -> None:
    report = json.loads((made.folder / "report.json").read_text())
    assert report == json.loads(msgspec.json.encode(made.report))
    for name, robot in report["robots"].items():
        at = made.page.cells.index(name)
        mass = robot["mass"]
        assert made.page.cells[at + 2 : at + 6] == [
            f"{mass['truth']:.3f}",
            f"{mass['estimate']:.3f}",
            *error_and_std(mass["error_pct"], 100.0 * mass["std"] / mass["truth"], "%"),
        ]
    (change,) = report["load_changes"]
    assert f"{change['truth']['mass']:.3f}" in made.page.cells
    assert f"{change['detected_at_s'] - change['at_s']:.2f}" in made.page.cells


def test_the_curves_end_where_the_report_does(made: Made) -> None:
    mass, com, inertia, rotation, translation = ALL_SHOWN
    for name, robot in made.report.robots.items():

        def end(shown: object, name: str = name) -> tuple[float, float]:
            (curve,) = curves(made.series, name, shown)  # type: ignore[arg-type]
            return float(curve.error[-1]), float(curve.std[-1])

        assert robot.mass.estimate is not None
        assert robot.com.std is not None
        assert end(mass) == pytest.approx((1e3 * abs(robot.mass.estimate - robot.mass.truth), 1e3 * robot.mass.std))
        assert end(com) == pytest.approx((robot.com.error_mm, 1e3 * np.linalg.norm(robot.com.std)))
        assert end(inertia)[1] == pytest.approx(np.linalg.norm(robot.inertia.std))
        (pose,) = robot.poses.values()
        assert end(rotation)[0] == pytest.approx(pose.rotation_error_deg)
        assert end(translation)[0] == pytest.approx(pose.translation_error_mm)


def test_the_change_is_shown_close_up_and_the_page_tells_who_was_stale(made: Made) -> None:
    (close_up,) = made.series.close_ups
    assert close_up.at == pytest.approx(4.0)
    assert {round(mass, 6) for _, mass in close_up.masses} == {6.0, 7.0}
    for points in close_up.points.values():
        assert points[0].time < 4.0 < points[-1].time
    states = [span.state for span in made.series.robots["r1"].spans]
    assert states[0] == "finding neighbours"
    assert "stale" in states
    assert states[-1] in ("all known", "converged")
    assert "looking" not in made.page.words
    assert "the load changed" in made.page.words.lower()


@pytest.mark.slow
def test_a_recording_with_a_gap_where_the_load_changed_has_a_page(made: Made, tmp_path: Path) -> None:
    scenario = parse_scenario(SCENARIO.replace("7.0", "5.0").replace("4.0\nmass", "1.0\nmass"), "two")
    follower, record = SeriesFollower(), Record(made.series.scene, scenario.duration)
    follower.begin(made.status)
    for block in run_in_process(scenario):
        if 0.4 < block.truth.time < 4.5:
            continue
        for news in (block.truth, *block.estimates.values()):
            follower.receive(news)
            record.receive(news)
    report = build_report(scenario, record)
    assert len(report.load_changes) == 1
    assert "load change at" in write_folder(tmp_path, scenario, None, follower.series, report).read_text()


def test_legends_fit_into_their_pictures(made: Made, monkeypatch: pytest.MonkeyPatch) -> None:
    every = [Span(float(k), k + 1.0, state, (), ()) for k, state in enumerate(State)]
    monkeypatch.setattr(made.series.robots["r1"], "spans", every)
    for picture in pictures_of(made.series, made.report):
        with figure_to(io.BytesIO(), 10.0, picture.height) as figure:
            picture.draw(figure, LIGHT, made.series, made.report)
            figure.canvas.draw()
            low, high = figure.bbox.get_points()
            for legend in figure.legends:
                box = legend.get_window_extent().get_points()
                assert (low <= box).all(), picture.name
                assert (box <= high).all(), picture.name
            assert all(axes.get_window_extent().height > 50.0 for axes in figure.axes if axes.get_visible())


def test_masses_that_are_stale_are_drawn_thin_and_dotted(made: Made) -> None:
    from matplotlib.figure import Figure

    figure = Figure()
    draw_overview(figure, LIGHT, made.series, made.report)
    (axes,) = figure.axes
    dotted = [line for line in axes.lines if line.get_linestyle() != "-" and line.get_linewidth() < 0.9]
    assert "stale" in [line.get_label() for line in dotted]
    for points in (list(robot.points) for robot in made.series.robots.values()):
        stale = {round(point.time, 6) for point in points if point.is_stale}
        assert stale
        drawn = [{round(t, 6) for t, y in zip(*line.get_data(), strict=True) if np.isfinite(y)} for line in dotted[:2]]
        assert any(stale <= times for times in drawn)


def test_what_others_say_stays_text(made: Made) -> None:
    assert "refused <b>nonsense</b>" in made.page.words


def test_the_data_is_there_as_parquet(made: Made) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    assert {path.stem for path in made.folder.glob("*.parquet")} == TABLES
    last = parquet.read_table(made.folder / "estimates.parquet").to_pylist()[-1]
    robot = made.report.robots[last["robot"]]
    assert (last["mass_kg"], last["std_mass_kg"]) == pytest.approx((robot.mass.estimate, robot.mass.std))
    assert last["true_com_x_m"] == pytest.approx(robot.com.truth[0])


def test_without_pyarrow_the_data_is_csv(made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(data, "find_spec", lambda name: None)
    files = data.write_data(made.series, tmp_path)
    assert {file.name for file in files} == {f"{name}.csv" for name in TABLES}
    with (tmp_path / "estimates.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert rows[0]["mass_kg"] == "", "nothing was known yet"
    assert float(rows[-1]["mass_kg"]) == pytest.approx(made.report.robots["r2"].mass.estimate)


def test_a_report_takes_the_place_of_a_former_one_and_leaves_alone_what_is_not_of_it(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(made.folder, tmp_path, dirs_exist_ok=True)
    former = {path.name for path in tmp_path.iterdir()}
    (tmp_path / "mine.png").write_text("")
    is_parquet = (tmp_path / "pace.parquet").exists()
    own = tmp_path / ("load-changes.csv" if is_parquet else "load-changes.parquet")
    own.write_text("")
    monkeypatch.setattr(data, "find_spec", lambda name: None)
    monkeypatch.setattr(folder, "_draw", lambda *_: b"")
    calm = dataclasses.replace(made.series, close_ups=[])
    write_folder(tmp_path, made.scenario, "lockstep", calm, msgspec.structs.replace(made.report, load_changes=[]))
    left = {path.name for path in tmp_path.iterdir()} - {"mine.png", own.name}
    gone = {path for path in former if path.startswith("load-changes.")}
    assert left == {path.replace(".parquet", ".csv") for path in former - gone}
    assert own.exists()
    assert (tmp_path / "mine.png").exists()


def test_a_page_that_is_no_report_has_nothing_beside_it_removed(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(folder, "_draw", lambda *_: b"")
    mine = tmp_path / "load-changes.csv"
    (tmp_path / "report.html").write_text("<h1>mine</h1>")
    mine.write_text("")
    calm = dataclasses.replace(made.series, close_ups=[])
    write_folder(tmp_path, made.scenario, "lockstep", calm, msgspec.structs.replace(made.report, load_changes=[]))
    assert mine.read_text() == ""


def test_a_long_series_is_thinned_evenly_and_keeps_its_end() -> None:
    thinned: Thinned[int] = Thinned(100)
    for number in range(12345):
        thinned.add(number)
    kept = list(thinned)
    assert len(kept) <= 101
    assert kept[0] == 0
    assert kept[-1] == 12344
    assert set(np.diff(kept[:-1])) == {thinned.every}


def test_a_robot_that_changes_its_mind_all_the_time_does_not_fill_the_memory() -> None:
    spans: list[Span] = []
    for block in range(3000):
        add_span(spans, estimate("r1", block, HEAVY if block % 2 else None, converged=block > 2000))
    assert len(spans) <= 401
    assert all(one.end == pytest.approx(other.start) for one, other in pairwise(spans))
    assert spans[-1].end == pytest.approx(60.0)


def test_a_folder_that_cannot_be_made_is_explained(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(CoheftError, match=r"cannot make the folder .*file: File exists; name another"),
        picture_folder(tmp_path / "file"),
    ):
        pass

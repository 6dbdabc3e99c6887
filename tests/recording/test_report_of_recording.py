"""The report of a recording is that of its run, but for what only the wall clock knew."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import pytest

from coheft.app.cli.base import EXIT_ERROR
from coheft.app.cli.main import run_command_line
from coheft.app.run_report.of_recording import report_recording
from coheft.wire.scenario.motion import Carry
from tests.recording import runs
from tests.recording.runs import news_of_a_run, record

pytest.importorskip("matplotlib")
pytest.importorskip("jinja2")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded")
    recording = record(folder / "run.mcap", news_of_a_run())
    assert run_command_line(["report", str(recording), str(folder / "report")]) == 0
    return folder / "report"


def test_it_has_the_numbers_of_the_run(made: Path) -> None:
    report = json.loads((made / "report.json").read_text())
    assert list(report["robots"]) == ["r1", "r2", "r3"]
    mass = report["robots"]["r2"]["mass"]
    assert mass["estimate"] == pytest.approx(1.1 * mass["truth"]), "as the recording was made"
    assert len(report["load_changes"]) == 1


def test_it_says_nothing_about_time_on_the_wall(made: Path) -> None:
    page = (made / "report.html").read_text()
    assert "a recording does not tell" in page
    assert not (made / "pace.png").exists()
    assert "real-time factor" not in page
    assert "real time</p>" not in page


def test_it_tells_how_the_load_was_carried(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("coheft.app.run_report.folder.pictures_of", lambda series, report: [])  # takes most of the time
    monkeypatch.setattr(runs, "SCENARIO", msgspec.structs.replace(runs.SCENARIO, carry=Carry(start=0.1)))
    recording = record(tmp_path / "run.mcap", news_of_a_run())
    page = report_recording(recording, tmp_path / "report")
    carried = json.loads((page.parent / "report.json").read_text())["carry"]
    assert carried["noise_force_n"] > 0.0
    assert carried["drops"][0]["at_s"] == pytest.approx(0.2)


def test_the_scene_is_in_the_page(made: Path) -> None:
    page = (made / "report.html").read_text()
    data = json.loads(page.split('id="scene-data">')[1].split("</script>")[0])
    assert [robot["name"] for robot in data["robots"]] == ["r1", "r2", "r3"]
    assert len(data["times"]) == len(data["positions"]) == len(data["quaternions"]) == 20
    assert set(data["states"]) == {"r1", "r2", "r3"}


def test_what_is_no_recording_leaves_no_folder(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "text.mcap").write_text("no recording")
    assert run_command_line(["report", str(tmp_path / "text.mcap"), str(tmp_path / "report")]) == EXIT_ERROR
    assert "text.mcap" in capfd.readouterr().err
    assert not (tmp_path / "report").exists()
    nothing = record(tmp_path / "nothing.mcap", [])
    assert run_command_line(["report", str(nothing), str(tmp_path / "report")]) == EXIT_ERROR
    assert "there is nothing to report" in capfd.readouterr().err
    assert not (tmp_path / "report").exists()

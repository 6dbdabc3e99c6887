"""Where commands write, and options that contradict each other: what cannot be is refused before anything is run."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import pytest

from coheft.app.cli.base import EXIT_CONVERGED, EXIT_ERROR, EXIT_INTERRUPTED, EXIT_USAGE
from coheft.app.cli.main import run_command_line
from coheft.app.cli.run import run
from coheft.app.results.report import Report
from coheft.errors import CoheftError, LinkError
from coheft.wire.scenario.file import scenario_path
from tests.synthetic_run import HEAVY, ROBOTS, built_report, estimate, recorded, truth

pytestmark = pytest.mark.usefixtures("own_state_folder")


@pytest.fixture
def nothing_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        pytest.fail("it was run")

    for what in (
        "run.launch.launch",
        "faults.campaign.run_campaign",
        "cart.campaign.run_cases",
        "study.campaign.run_study",
    ):
        monkeypatch.setattr(f"coheft.app.{what}", fail)
    monkeypatch.setattr("coheft.app.mocobots.campaign.run_campaign", fail)


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with some things in it."""
    folder = tmp_path / "place"
    for name in ("folder", "folder.npz", "foreign", "samples"):
        (folder / name).mkdir(parents=True)
    (folder / "file").write_text("text")
    shutil.copy(scenario_path("ring3"), folder / "mine.toml")
    (folder / "samples" / "r1.csv").write_text("time\n")
    (folder / "foreign" / "results.csv").write_text("mass\n")
    monkeypatch.chdir(folder)
    return folder


def refused(line: str, complaint: str, capfd: pytest.CaptureFixture[str], place: Path) -> None:
    before = sorted(place.rglob("*"))
    assert run_command_line([word.removeprefix("''") for word in line.split()]) == EXIT_USAGE
    assert complaint in capfd.readouterr().err
    assert sorted(place.rglob("*")) == before


@pytest.mark.usefixtures("nothing_runs")
@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("run ring3 --json folder", "--json: expected a file; found the folder 'folder'"),
        ("run ring3 --json ''", "--json: expected a file, or - for standard output; found ''"),
        ("run ring3 --report ''", "--report: expected the name of a file or folder; found ''"),
        ("run ring3 --report file", "--report: expected a folder; found the file 'file'"),
        ("run ring3 --report file/below", "--report: expected a folder; found the file 'file'"),
        ("run ring3 --logs file", "--logs: expected a folder; found the file 'file'"),
        ("run ring3 --logs file/below/it", "--logs: expected a folder; found the file 'file'"),
        ("run ring3 --write-configs file", "--write-configs: expected a folder; found the file 'file'"),
        ("run ring3 --write-configs file/below", "--write-configs: expected a folder; found the file 'file'"),
        ("keys file", "FOLDER: expected a folder; found the file 'file'"),
        ("keys file/below", "FOLDER: expected a folder; found the file 'file'"),
        ("run ring3 --save-data folder.npz", "--save-data: expected a file; found the folder 'folder.npz'"),
        ("run ring3 --save-data file", "--save-data: expected a folder; found the file 'file'"),
        (
            "run ring3 --save-data x.csv",
            "expected a file that ends with .npz, or a folder, without suffix; found 'x.csv'",
        ),
        ("run ring3 --save-data foreign", "--save-data: found files there that are of no"),
        ("run ring3 --json x.npz --save-data ./x.npz", "--json and --save-data both name 'x.npz'"),
        ("run ring3 --report folder --save-data folder", "--report and --save-data both name 'folder'"),
        (
            "run ring3 --history",
            "--history adds to the report, but none was requested: add --json FILE or --report DIR",
        ),
        ("run ring3 --keys nokeys", "--keys: there is no folder 'nokeys'"),
        ("faults --table none/x.md", "--table: there is no folder 'none'"),
        ("faults --table folder", "--table: expected a file; found the folder 'folder'"),
        ("faults --kept none/x", "--kept: there is no folder 'none'"),
        ("faults --table x --kept x", "--table and --kept both name 'x'"),
        ("faults --mutant foo", "there is no mutant 'foo'; available: half-complete-row"),
        ("faults --shrink", "--shrink simplifies one schedule: name it with --replay SEED"),
        ("faults --replay 3 --json x.json", "--json is for a campaign, but --replay runs a single schedule"),
        ("faults --replay 3 --seeds 5", "--seeds is for a campaign"),
        ("cart --figures file", "--figures: expected a folder; found the file 'file'"),
        ("cart --test 1 --all", "--all runs all tests of Table I, --test 1 only one"),
        ("cart --processes --jobs 2", "--jobs is for runs side by side, but with --processes"),
        ("cart --json x --figures x", "--json and --figures both name 'x'"),
        ("study --report file", "--report: expected a folder; found the file 'file'"),
        ("study --json x --report x", "--json and --report both name 'x'"),
        ("identify folder --json x --report x", "--json and --report both name 'x'"),
        ("mocobots --markdown folder", "--markdown: expected a file; found the folder 'folder'"),
        ("mocobots --json x --markdown x", "--json and --markdown both name 'x'"),
        ("run mine.toml --json ./mine.toml", "--json names './mine.toml', which is an input: give another path"),
        ("study mine.toml --json mine.toml", "--json names 'mine.toml', which is an input"),
        ("identify file --force-scale 0.1", "bounds are of errors that --calibrate estimates: add it"),
        ("identify file --calibrate --position-scale 1", "--position-scale 1: expected a bound from 0 to less than 1"),
        ("identify file --calibrate --force-scale=-0.1", "--force-scale -0.1: expected a bound from 0 to less than 1"),
        (
            "identify file --calibrate --force-offset nan",
            "--force-offset nan: expected a bound from 0 to less than inf",
        ),
        ("identify file --json file", "--json names 'file', which is an input"),
        ("identify samples --json samples/r1.csv", "--json names 'samples/r1.csv', which is an input"),
        ("recover r.mcap --output folder", "--output: expected a file; found the folder 'folder'"),
        ("run --seed 1.9", "--seed: expected a whole number; found '1.9'"),
        ("run --sensor-rate 1000.5", "--sensor-rate: expected a whole number; found '1000.5'"),
        ("cart --test 1.5", "--test: expected a whole number; found '1.5'"),
        ("study --sensor-rate 99.7", "--sensor-rate: expected a whole number; found '99.7'"),
        ("cart --friction-guess inf", "--friction-guess: expected a finite number; found inf"),
        ("cart identify file --force-noise inf", "--force-noise: expected a finite number; found inf"),
        ("faults --jobs 1.5", "--jobs: expected a whole number; found '1.5'"),
        ("view --port 80.5", "--port: expected a whole number; found '80.5'"),
        ("remove 1.5", "LOAD: expected a whole number; found '1.5'"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_run(
    line: str, complaint: str, capfd: pytest.CaptureFixture[str], place: Path
) -> None:
    refused(line, complaint, capfd, place)


@pytest.mark.usefixtures("nothing_runs")
@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs a folder that takes no files from anybody")
@pytest.mark.parametrize("option", ["--json", "--report", "--save-data", "--record", "--logs", "--write-configs"])
def test_folders_that_take_no_files_are_found_out(option: str, capfd: pytest.CaptureFixture[str], place: Path) -> None:
    suffix = {"--json": ".json", "--save-data": ".npz", "--record": ".mcap"}.get(option, "")
    refused(f"run ring3 {option} /proc/x{suffix}", f"{option}: may not write", capfd, place)


@pytest.mark.usefixtures("nothing_runs")
@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs a folder that takes no files from anybody")
def test_a_folder_for_keys_that_takes_no_files_is_found_out(capfd: pytest.CaptureFixture[str], place: Path) -> None:
    refused("keys /proc/x", "FOLDER: may not write into '/proc/x'", capfd, place)


@pytest.mark.parametrize("command", ["cart --figures", "study --report"])
@pytest.mark.usefixtures("nothing_runs")
def test_pictures_are_not_asked_for_in_vain(
    command: str, capfd: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert run_command_line([*command.split(), str(tmp_path / "figures")]) == EXIT_ERROR
    assert "this needs the package 'matplotlib'" in capfd.readouterr().err
    assert not (tmp_path / "figures").exists()


def test_outputs_may_be_there_already_and_be_no_files(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A report is written anew; a device is no folder that would take files."""
    monkeypatch.setattr("coheft.app.run.launch.launch", lambda *_, **__: report())
    for arguments in (["--json", "file"], ["--json", os.devnull], ["--save-data", "new"], ["--save-data", "new.npz"]):
        assert run_command_line(["run", "ring3", "--quiet", *arguments]) == EXIT_CONVERGED


def report() -> Report:
    """Of a run that never was."""
    truths = [truth(block, HEAVY) for block in range(10)]
    return built_report(recorded(truths, {name: [estimate(name, 9, HEAVY)] for name in ROBOTS}))


def test_a_report_that_cannot_be_written_takes_nothing_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()

    def launch(*_: object, **__: object) -> Report:
        shutil.rmtree(folder)
        return report()

    monkeypatch.setattr("coheft.app.run.launch.launch", launch)
    monkeypatch.setattr("coheft.app.run_report.series.SeriesFollower.series", None, raising=False)
    monkeypatch.setattr("coheft.app.run_report.folder.write_folder", lambda *_: "the page")
    assert (
        run_command_line(["run", "ring3", "--json", str(folder / "x.json"), "--report", str(tmp_path / "page")])
        == EXIT_ERROR
    )
    said = capfd.readouterr()
    assert "What each robot found out about the payload" in said.out
    assert "Report: the page" in said.out
    assert "cannot write the report to" in said.err


def test_where_things_were_written_is_said_at_the_end(
    place: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("coheft.app.run.launch.launch", lambda *_, **__: report())
    arguments = ["run", "ring3", "--save-data", "new.npz", "--record", "new.mcap"]
    data, recording = "Data: new.npz", "Recording: new.mcap"
    assert run_command_line([*arguments, "--json", "file"]) == EXIT_CONVERGED
    said = capfd.readouterr()
    assert said.out.splitlines()[-3:] == ["JSON report: file", data, recording]
    assert run_command_line([*arguments, "--json", "-"]) == EXIT_CONVERGED
    said = capfd.readouterr()
    assert said.err.splitlines()[-2:] == [data, recording]
    assert data not in said.out
    assert "JSON report" not in said.err
    assert run_command_line([*arguments, "--json", "file", "--quiet"]) == EXIT_CONVERGED
    assert capfd.readouterr() == ("", "")


def test_an_error_that_breaks_a_run_off_stays_of_its_kind(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise LinkError("no link")

    monkeypatch.setattr("coheft.app.run.launch.launch", fail)
    with pytest.raises(LinkError, match=r"^no link\nThat was before it began: no report \(--json\) was written\.$"):
        run("ring3", quiet=True, json=str(place / "x.json"))


@pytest.mark.parametrize(
    "command", ["run ring3 --report", "study ring3 --report", "cart --jobs 1 --figures", "identify run.npz --report"]
)
def test_what_is_broken_off_leaves_no_empty_folder(command: str, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("matplotlib")
    pytest.importorskip("jinja2")

    def interrupted(*_: object, **__: object) -> None:
        assert Path("some/new").is_dir()
        raise KeyboardInterrupt

    for name in (
        "run.launch.launch",
        "study.campaign.run_study",
        "cart.campaign.run_cases",
        "identify.methods.evaluate",
    ):
        monkeypatch.setattr(f"coheft.app.{name}", interrupted)
    before = sorted(place.rglob("*"))
    assert run_command_line([*command.split(), "some/new"]) == EXIT_INTERRUPTED
    assert sorted(place.rglob("*")) == before
    Path("some/new").mkdir(parents=True)
    assert run_command_line([*command.split(), "some/new"]) == EXIT_INTERRUPTED
    assert Path("some/new").is_dir()


def test_a_campaign_whose_summary_cannot_be_written_tells_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: object) -> None:
        raise CoheftError("cannot write")

    monkeypatch.setattr("coheft.app.faults.campaign.run_campaign", lambda *_, **__: [])
    monkeypatch.setattr("coheft.app.faults.summary.summarise", lambda _: None)
    monkeypatch.setattr("coheft.app.faults.output.print_campaign", lambda *_: print("the summary"))
    monkeypatch.setattr("coheft.app.faults.output.markdown", lambda _: "the table")
    monkeypatch.setattr("coheft.app.results.report.write_report", fail)
    table = tmp_path / "table.md"
    arguments = [
        "faults",
        "--seeds",
        "1",
        "--first-seed",
        "0",
        "--json",
        str(tmp_path / "x.json"),
        "--table",
        str(table),
    ]
    assert run_command_line(arguments) == EXIT_ERROR
    assert "the summary" in capfd.readouterr().out
    assert table.read_text() == "the table"

"""Which folders of runs are kept."""

from __future__ import annotations

import os
import socket
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from coheft.app.cli.cart import log_folders
from coheft.app.run.folder import (
    END_FILE,
    RUN_FILE,
    RunFile,
    announced,
    find_run,
    make_run_folder,
    note_end,
    noted_end,
    runs_folder,
    runs_in_progress,
    split_endpoint,
)
from coheft.errors import CoheftError
from tests.ports import free_port

pytestmark = pytest.mark.usefixtures("own_state_folder")


@pytest.fixture
def endpoint() -> Iterator[str]:
    """Where somebody listens, as a run's server does."""
    port = free_port()
    with socket.create_server(("127.0.0.1", port)):
        yield f"tcp/127.0.0.1:{port}"


def test_the_newest_folders_are_kept_and_those_of_runs_that_go_on(endpoint: str) -> None:
    old = [runs_folder() / f"20200101-0000{number:02}-coheft-{number}" for number in range(30)]
    other = runs_folder() / "not-of-a-run"
    for folder in (*old, other):
        folder.mkdir(parents=True)
        (folder / "server.log").write_text("log")
    with announced(old[0], RunFile(run="coheft-0", server=endpoint, agents={})):
        new = make_run_folder("coheft-new")
    assert set(runs_folder().iterdir()) == {old[0], *old[-19:], new, other}


def test_a_user_without_a_home_can_name_the_place_of_runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)  # as for a user who is in no list of users
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert runs_folder() == tmp_path / "coheft" / "runs"
    monkeypatch.delenv("XDG_STATE_HOME")
    with pytest.raises(CoheftError, match="no home folder for runs: name a folder with --logs"):
        runs_folder()


def test_two_runs_have_no_folder_in_common(endpoint: str, tmp_path: Path) -> None:
    there = announced(tmp_path, RunFile(run="coheft-0", server=endpoint, agents={}))
    with there, pytest.raises(CoheftError, match="a run is in progress in"):
        make_run_folder("coheft-new", tmp_path)
    assert make_run_folder("coheft-new", tmp_path) == tmp_path.resolve()


@pytest.mark.parametrize("name", ["r1.log", RUN_FILE])
def test_what_is_in_a_folder_is_not_overwritten(name: str, tmp_path: Path) -> None:
    (tmp_path / "report.json").write_text("no log")
    assert make_run_folder("coheft-new", tmp_path) == tmp_path.resolve()
    (tmp_path / name).write_text("mine")
    with pytest.raises(CoheftError, match=f"{name} exists already: .* name another folder: --logs DIR"):
        make_run_folder("coheft-new", tmp_path)
    assert (tmp_path / name).read_text() == "mine"


@pytest.mark.parametrize(("host", "written"), [("127.0.0.1", "127.0.0.1"), ("::1", "[::1]"), ("arm", "arm")])
def test_an_endpoint_names_a_host_and_a_port(host: str, written: str) -> None:
    assert split_endpoint(f"tcp/{written}:20000") == (host, 20000)


def test_whoever_names_a_file_is_told_what_was_expected(tmp_path: Path) -> None:
    (tmp_path / "keep.json").write_text("{}")
    expected = "keep.json: expected the folder of a run, or, for 'coheft view', a recording that ends with .mcap"
    with pytest.raises(CoheftError, match=expected):
        find_run(tmp_path / "keep.json")
    with pytest.raises(CoheftError, match=rf"no run is in progress in {tmp_path}$"):
        find_run(tmp_path)


def test_many_runs_of_one_command_count_as_one() -> None:
    old = [runs_folder() / f"20200101-0000{number:02}-coheft-{number}" for number in range(19)]
    for folder in old:
        folder.mkdir(parents=True)
    make_folder = log_folders()
    folders = {make_folder(f"cart-{number}") for number in range(30)}
    assert len(folders) == 30
    assert all(folder.is_dir() for folder in (*old, *folders))
    assert len(list(runs_folder().iterdir())) == 20


def test_a_folder_of_the_users_own_choice_removes_none(tmp_path: Path) -> None:
    old = [runs_folder() / f"20200101-0000{number:02}-coheft-{number}" for number in range(30)]
    for folder in old:
        folder.mkdir(parents=True)
    make_run_folder("coheft-new", tmp_path / "logs")
    assert all(folder.is_dir() for folder in old)


def test_a_run_in_a_folder_of_the_users_own_choice_is_found_while_it_goes_on(endpoint: str, tmp_path: Path) -> None:
    """Else ``coheft inject`` would change another run without asking."""
    folder = make_run_folder("coheft-new", tmp_path / "logs")
    with announced(folder, RunFile(run="coheft-new", server=endpoint, agents={})):
        assert find_run().run == "coheft-new"
        make_run_folder("coheft-newer")
        assert find_run(acts=True).run == "coheft-new"
    with pytest.raises(CoheftError, match="no run is in progress"):
        find_run()
    assert folder.is_dir()


def test_links_to_runs_that_were_killed_are_removed(tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    runs_folder().mkdir(parents=True)
    links = [runs_folder() / f"20200101-0000{number:02}-coheft-{number}" for number in range(30)]
    for link in links:
        link.symlink_to(tmp_path / "logs")
    make_run_folder("coheft-new")
    assert len(list(runs_folder().iterdir())) == 20
    assert (tmp_path / "logs").is_dir()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no disk here that is always full")
def test_a_full_disk_names_the_file_and_what_to_do(endpoint: str, tmp_path: Path) -> None:
    (tmp_path / f"{RUN_FILE}.new").symlink_to("/dev/full")
    expected = rf"cannot write {tmp_path}/{RUN_FILE}\.new: No space left on device; .*--logs"
    with (
        pytest.raises(CoheftError, match=expected),
        announced(tmp_path, RunFile(run="run", server=endpoint, agents={})),
    ):
        pytest.fail("it begins")


def test_whoever_names_no_run_hears_that_there_are_others(endpoint: str, capsys: pytest.CaptureFixture[str]) -> None:
    old, new = (runs_folder() / f"20200101-00000{number}-coheft-{number}" for number in range(2))
    for folder in (old, new):
        folder.mkdir(parents=True)
    with announced(new, RunFile(run="coheft-1", server=endpoint, agents={}, began=1.0)):
        assert find_run().run == find_run(acts=True).run == "coheft-1"
        assert capsys.readouterr().err == ""
        with announced(old, RunFile(run="coheft-0", server=endpoint, agents={})):
            assert find_run().run == "coheft-1"
            expected = f"2 runs are in progress: the newest is {new.name}; others, for --run DIR: {old.name}\n"
            assert capsys.readouterr().err == expected
            with pytest.raises(CoheftError, match=f"2 runs are in progress.*--run DIR.*{new.name}.*{old.name}"):
                find_run(acts=True)
            assert [place for place, _ in runs_in_progress()] == [new, old]
            assert find_run(old, acts=True).run == find_run(old).run == "coheft-0"
            assert find_run(Path(old.name)).run == "coheft-0"
            assert capsys.readouterr().err == ""


def test_a_folder_here_comes_before_one_of_the_same_name_among_the_runs(
    endpoint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for folder in (tmp_path / "mine", runs_folder() / "mine"):
        folder.mkdir(parents=True)
    with announced(runs_folder() / "mine", RunFile(run="coheft-0", server=endpoint, agents={})):
        with pytest.raises(CoheftError, match=r"no run is in progress in mine$"):
            find_run(Path("mine"))
        with announced(tmp_path / "mine", RunFile(run="coheft-1", server=endpoint, agents={})):
            assert find_run(Path("mine")).run == "coheft-1"


def test_how_a_run_has_ended_stays_in_its_folder_until_the_next_one_begins(tmp_path):
    run_file = RunFile("run", "tcp/127.0.0.1:1", {})
    with announced(tmp_path, run_file):
        assert noted_end(tmp_path) is None
        note_end(tmp_path, 12.5)
    assert noted_end(tmp_path) == 12.5
    with announced(tmp_path, run_file):
        assert noted_end(tmp_path) is None
    (tmp_path / END_FILE).write_text("{")
    assert noted_end(tmp_path) is None

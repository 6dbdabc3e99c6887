"""The command line, as far as it goes without other processes."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import coheft
from coheft.app.cli.base import EXIT_CONVERGED, EXIT_ERROR, EXIT_USAGE
from coheft.app.cli.main import run_command_line
from coheft.app.run.overrides import override
from coheft.errors import ScenarioError
from coheft.wire.scenario.file import available_scenarios, load_scenario
from coheft.wire.scenario.schema import LoadChange, Scenario

ROOT = Path(__file__).parents[1]

pytestmark = pytest.mark.usefixtures("own_state_folder")


@pytest.fixture
def ring6() -> Scenario:
    return load_scenario("ring6")


def test_overrides_change_what_they_name_and_nothing_else(ring6: Scenario) -> None:
    changed = override(ring6, duration=12.0, seed=7, sensor_rate=250)
    assert (changed.duration, changed.seed, changed.sensors.rate) == (12.0, 7, 250)
    same_again = override(changed, duration=ring6.duration, seed=ring6.seed, sensor_rate=ring6.sensors.rate)
    assert same_again == ring6


def test_changes_replace_the_scenarios_own(ring6: Scenario) -> None:
    texts = ["t=20,mass=3,at=0.4,-0.3,0.1,leak=0.2", "remove=1,t=25.5", "mass=2,t=1,size=0.1,0.2,0.3"]
    changed = override(ring6, changes=texts)
    assert changed.load_changes == (
        LoadChange(at=20.0, mass=3.0, position=(0.4, -0.3, 0.1), leak=0.2),
        LoadChange(at=25.5, remove=1),
        LoadChange(at=1.0, mass=2.0, size=(0.1, 0.2, 0.3)),
    )


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("mass=3", "key 't': it is missing"),
        ("t=20,weight=3", "'weight' is unknown"),
        ("t=20,mass=3,mass=4", "twice"),
        ("t=20,mass=heavy", "key 'mass': expected a number; found \"heavy\""),
        ("t=20,mass=3,at=0.4,0.3", "key 'at': expected 3 numbers; found"),
        ("20,mass=3", "'20'"),
        ("t=20,mass=-3", "a number greater than 0"),
        ("t=20,remove=1.5", "remove"),
        ("t=20", "'mass'"),
        ("t=20,mass=3,remove=1", "'remove'"),
        ("t=20,remove=1,leak=0.1", "leak"),
    ],
)
def test_a_change_that_makes_no_sense_is_explained(ring6: Scenario, text: str, complaint: str) -> None:
    with pytest.raises(ScenarioError, match=complaint):
        override(ring6, changes=[text])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"estimator": "foo"}, "--estimator: found 'foo', expected one of: efficient, fan2017"),
        ({"sensor_rate": 300}, "--sensor-rate: expected one of 100, 125, .*; found 300"),
        ({"duration": -5.0}, "--duration: expected a number greater than 0; found -5.0"),
        ({"seed": -1}, "--seed: expected a whole number of at least 0; found -1"),
        ({"changes": ["t=-1,mass=3"]}, "--change t=-1,mass=3: key 't': expected a number of at least 0; found \"-1\""),
        (
            {"changes": ["t=8,mass=3", "t=9,remove=3"]},
            "--change t=9,remove=3: key 'remove': found 3 at 9.0 s, .* \\[1\\]",
        ),
        (
            {"changes": ["t=9,mass=3000,at=0,0,0"]},
            "--change t=9,mass=3000,at=0,0,0: key 'mass': found 3000 kg .* in kg",
        ),
        ({"changes": ["t=9,mass=3,at=9,0,0"]}, "--change t=9,mass=3,at=9,0,0: key 'at': found .9.0, 0.0, 0.0., which"),
        ({"changes": ["t=9"]}, "--change t=9: found neither 'mass' nor 'remove'"),
        ({"changes": ["t=99,mass=3"]}, "--change t=99,mass=3: key 't': found 99.0 s, .* = 35.0 s"),
        (
            {"changes": ["t=9,mass=3"], "duration": 5.0},
            "--change t=9,mass=3: key 't': found 9.0 s, .* = 5.0 s",
        ),
    ],
)
def test_overrides_that_cannot_be_are_explained(ring6: Scenario, given: dict[str, Any], message: str) -> None:
    with pytest.raises(ScenarioError, match=f"^{message}"):
        override(ring6, **given)


def test_a_shorter_run_may_end_before_the_load_changes_of_its_scenario_come(ring6: Scenario) -> None:
    assert override(ring6, duration=5.0).load_changes == ring6.load_changes


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["run", "ring5"], "ring6"),
        (["run", "ring6", "--duration", "-1"], "duration"),
        (["run", "ring6", "--sensor-rate", "333"], "rate"),
        (["run", "ring6", "--estimator", "magic"], "estimator"),
        (["run", "ring6", "--change", "mass=3"], "key 't'"),
        (["run", "--no-such-flag"], "--no-such-flag"),
        (["run", "ring6", "--json", "/no/such/folder/report.json"], "/no/such/folder"),
        (["run", "ring6", "--json", "--quiet"], "--quiet"),
        (["run", "ring6", "--record", "/no/such/folder/run.mcap"], "/no/such/folder"),
        (["run", "ring6", "--record", "run.bag"], ".mcap"),
        (["run", "ring6", "--record", "new.mcap", "--write-configs", "folder"], "--write-configs"),
        (["run", "ring6", "--json", "report.json", "--write-configs", "folder"], "--json"),
        (["run", "ring6", "--hosts", "hosts.toml"], "--write-configs"),
        (["inject", "--mass", "3"], "--at"),
        (["stop", "--list", "--run", "mine"], "leave out --run"),
    ],
)
def test_wrong_usage_exits_with_2_and_says_why(
    arguments: list[str], complaint: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(arguments) == EXIT_USAGE
    output = capfd.readouterr()
    assert complaint in output.err + output.out
    assert "Traceback" not in output.err + output.out


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["rn"], "Unknown command 'rn'. Did you mean 'run'? See 'coheft --help'"),
        (["run", "--seed", "x"], "--seed: expected a whole number; found 'x'. See 'coheft run --help'"),
        (
            ["faults", "--seeds", "0"],
            "--seeds: expected a whole number of at least 1; found 0. See 'coheft faults --help'",
        ),
        (
            ["keys", "x", "--days", "nan"],
            "--days: expected a number of at most 36500; found nan. See 'coheft keys --help'",
        ),
        (["run", "a", "b"], "'coheft run' does not know what to do with 'b'. See 'coheft run --help'"),
        (["run", "--json"], "--json needs a value. See 'coheft run --help'"),
        (["identify"], "'coheft identify' needs RECORDING. See 'coheft identify --help'"),
        (["inject", "--mass", "3"], "'coheft inject' needs --at, with 3 values. See 'coheft inject --help'"),
        (
            ["inject", "--mas", "3", "--at", "0", "0", "-0.1"],
            "Unknown option: --mas. Did you mean --mass? See 'coheft inject --help'",
        ),
        (["inject", "--mas=3"], "Unknown option: --mas. Did you mean --mass? See 'coheft inject --help'"),
        (
            ["inject", "--mass", "3", "--at", "1", "2", "3", "--siz", "1", "1", "1"],
            "Unknown option: --siz. Did you mean --size? See 'coheft inject --help'",
        ),
        (["inject", "--mass", "3", "--at", "1", "2"], "--at needs 3 values; found 2. See 'coheft inject --help'"),
    ],
)
def test_wrong_arguments_are_explained_in_one_sentence(
    arguments: list[str], sentence: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(arguments) == EXIT_USAGE
    assert capfd.readouterr() == ("", f"coheft: {sentence}\n")


def test_help_can_be_asked_for_by_name(capfd: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["help", "inject"]) == EXIT_CONVERGED
    assert "--mass" in capfd.readouterr().out
    assert run_command_line(["help", "injekt"]) == EXIT_USAGE
    assert "there is no command 'injekt'" in capfd.readouterr().err
    assert run_command_line(["help", "cart", "identify"]) == EXIT_CONVERGED
    assert "--force-noise" in capfd.readouterr().out


def test_the_reference_of_commands_is_up_to_date() -> None:
    # In a process of its own: what runs, 'python -m pytest' here, gets into the usage lines.
    ask = [sys.executable, "-c", "from docs import command_reference as it; print(it.page(), end='')"]
    page = subprocess.run(ask, capture_output=True, text=True, check=True, cwd=ROOT).stdout
    assert (ROOT / "docs" / "commands.md").read_text() == page, "run python docs/command_reference.py"
    for command in ("run", "scenarios", "watch", "help"):
        assert f"## `coheft {command}`" in page


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")
def test_bash_completes_commands_and_options(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert run_command_line(["completion", "bash"]) == EXIT_CONVERGED
    script = tmp_path / "completion.bash"
    script.write_text(capfd.readouterr().out)
    for words, expected in (("coheft ru", "run"), ("coheft run --sen", "--sensor-rate")):
        last = len(words.split()) - 1
        ask = f"source {script}; COMP_WORDS=({words}); COMP_CWORD={last}; _coheft; echo ${{COMPREPLY[@]}}"
        done = subprocess.run(["bash", "-c", ask], capture_output=True, text=True, check=True)
        assert done.stdout.split() == [expected]


@pytest.mark.skipif(os.name != "posix", reason="the home folder as on POSIX")
def test_completion_is_installed_where_bash_finds_it(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "coheft", "completion", "bash", "--install"]
    home = {**os.environ, "HOME": str(tmp_path)}
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT, env=home)
    assert done.returncode == EXIT_CONVERGED, done.stderr
    path = done.stdout.removeprefix("installed ").partition(";")[0]
    assert "--sensor-rate" in Path(path).read_text()
    assert Path(path).is_relative_to(tmp_path)
    assert path in (tmp_path / ".bashrc").read_text()


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_have_a_script_too(shell: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["completion", shell]) == EXIT_CONVERGED
    assert "sensor-rate" in capfd.readouterr().out


def test_a_malformed_scenario_names_file_key_found_and_allowed(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "odd.toml"
    path.write_text('name = "odd"\n[payload]\nboxes = [{ mass = -7.0, size = [1, 1, 1] }]\n[robots]\n')
    assert run_command_line(["run", str(path)]) == EXIT_USAGE
    message = capfd.readouterr().err
    for part in (str(path), "payload.boxes", "mass", "-7.0", "greater than 0"):
        assert part in message


def test_a_place_that_cannot_be_written_is_said_without_a_traceback(
    capfd: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), "place")

    monkeypatch.setattr("coheft.app.run.plan.Plan.write", fail)
    assert run_command_line(["run", "ring3", "--write-configs", str(tmp_path)]) == EXIT_ERROR
    assert capfd.readouterr().err == "coheft: place: File exists\n"


def test_version(capfd: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["--version"]) == EXIT_CONVERGED
    assert coheft.__version__ in capfd.readouterr().out


def test_help_tells_the_exit_status(capfd: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["--help"]) == EXIT_CONVERGED
    text = " ".join(capfd.readouterr().out.split())
    assert "3 not every robot converged, or an estimate is further off than it claims (or: incomplete or " in text
    for command in ("run", "watch", "cart identify"):
        assert run_command_line(["help", *command.split()]) == EXIT_CONVERGED
        assert ("Exit status: " in capfd.readouterr().out) == (command == "run")


def test_help_tells_how_changes_and_places_are_written(capfd: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["run", "--help"]) == EXIT_CONVERGED
    text = " ".join(capfd.readouterr().out.replace("│", " ").split())
    assert "t=20,mass=3,at=0.4,0.3,0.1 drops 3 kg at 20 s, at this position in the payload's frame [m]." in text
    assert run_command_line(["inject", "--help"]) == EXIT_CONVERGED
    assert "[default: 0.1 0.1 0.1]" in " ".join(capfd.readouterr().out.replace("│", " ").split())


def test_help_offers_no_empty_vectors(capfd: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["inject", "--help"]) == EXIT_CONVERGED
    text = capfd.readouterr().out
    assert "--at" in text
    assert "--empty" not in text


def test_scenarios_lists_every_shipped_one(capfd: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["scenarios"]) == EXIT_CONVERGED
    lines = capfd.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    names = [line.split()[0] for line in lines if not line.startswith(" ")]
    assert sorted(names) == list(available_scenarios())
    assert [name for name in names if name.startswith("ring")] == ["ring3", "ring6", "ring12", "ring24"]
    starts = {len(line) - len(line.partition(" ")[2].lstrip()) for line in lines}
    assert len(starts) == 1, "descriptions stand in one column"


def test_commands_for_a_run_need_one(capfd: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["inject", "--mass", "3", "--at", "0", "0", "0.1"]) == EXIT_ERROR
    assert "no run is in progress" in capfd.readouterr().err


@pytest.mark.parametrize("command", ["watch", "stop", "view", "ros2-bridge"])
def test_all_commands_for_a_run_find_it_as_their_errors_advise(
    command: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    if command == "view":
        pytest.importorskip("viser")
    assert run_command_line([command, "--run", str(tmp_path)]) == EXIT_ERROR
    assert f"no run is in progress in {tmp_path}" in capfd.readouterr().err

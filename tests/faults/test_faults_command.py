"""The command that breaks things: what it says, and how it ends, when a promise was broken."""

from __future__ import annotations

import json
import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec
import pytest

from coheft.app.cli.base import EXIT_BROKEN_PROMISE, EXIT_CONVERGED, EXIT_INTERRUPTED, EXIT_USAGE
from coheft.app.cli.main import run_command_line
from coheft.app.faults import campaign
from coheft.app.faults.draw import draw_schedule
from coheft.app.faults.invariants import Violation
from coheft.app.faults.recovery import latest_recovery
from coheft.app.faults.schedule import Loss, read_schedule, write_schedule
from coheft.app.faults.trial import Outcome
from coheft.wire.scenario.schema import Graph
from tests.faults.drawn import plain
from tests.waiting import wait_until

MUTANT = "no-lever-arm"
"""With it no team agrees, whatever else happens."""
_replace = msgspec.structs.replace


@pytest.fixture
def made_up(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> set[int]:
    """Seeds whose schedules break two promises each, without running them; the others break none."""
    monkeypatch.chdir(tmp_path)
    broken: set[int] = set()

    def try_seed(seed: int, mutant: str = "", values: Sequence[str] = ()) -> Outcome:
        return Outcome(
            seed=seed,
            faults=("lie (scaled)",),
            last="lie (scaled)",
            simulated=9.0,
            violations=[Violation(f"P{k}", k, "r2", f"mass of [load] {k} off") for k in (1, 3) if seed in broken],
            first_valid=2.0,
            recovered=0.5 * seed,
            stale=0.1,
            refused=0,
            lied=2,
            named=1,
        )

    monkeypatch.setattr(campaign, "try_seed", try_seed)
    return broken


def test_a_campaign_in_which_all_is_kept_ends_well(made_up: set[int], capfd: pytest.CaptureFixture[str]) -> None:
    assert not made_up
    assert run_command_line(["faults", "--seeds", "2", "--jobs", "1"]) == EXIT_CONVERGED
    out = capfd.readouterr().out
    assert "violations: 0, in 0 schedules" in out
    assert "--replay" not in out


def test_the_last_line_shows_the_first_broken_promise_again(
    made_up: set[int], capfd: pytest.CaptureFixture[str]
) -> None:
    made_up |= {6, 8}
    arguments = ["faults", "--first-seed", "5", "--seeds", "4", "--jobs", "1"]
    assert run_command_line(arguments) == EXIT_BROKEN_PROMISE
    lines = capfd.readouterr().out.splitlines()
    assert lines[-4:] == [
        "violations: 4, in 2 schedules",
        "6: P1 at 1.00 s, r2 mass of [load] 1 off",
        "8: P1 at 1.00 s, r2 mass of [load] 1 off",
        "coheft faults --replay 6",
    ]
    assert "4 of 8 agents that lied were named by others" in lines
    assert run_command_line([*arguments, "--quiet"]) == EXIT_BROKEN_PROMISE
    assert capfd.readouterr() == ("", "")


def test_values_that_are_not_drawn_are_part_of_what_shows_it_again(
    made_up: set[int], capfd: pytest.CaptureFixture[str]
) -> None:
    made_up.add(6)
    values = ["--set", "sensors.rate=200", "--set", "motion.frequency=[0.5, 1.5]"]
    assert run_command_line(["faults", "--first-seed", "6", "--seeds", "1", *values]) == EXIT_BROKEN_PROMISE
    last = capfd.readouterr().out.splitlines()[-1]
    assert shlex.split(last) == ["coheft", "faults", "--replay", "6", *values]


def test_values_may_be_set_in_schedules_whose_last_change_comes_late() -> None:
    values = ["sensors.noise_scale=2.0"]
    assert draw_schedule(1039552089, values=values).scenario.sensors.noise_scale == 2.0


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--set", "graph.kind=line"], "key 'graph' is drawn together with the faults"),
        (["--set", "sensors.rates=3"], "Did you mean 'rate'?"),
        (["--set", "sensors.rate=300"], "expected one of 100"),
        (["--replay", "schedule.json", "--set", "sensors.rate=200"], "holds a whole schedule: change it there"),
    ],
)
def test_values_that_cannot_be_set_are_refused_before_anything_runs(
    arguments: list[str], complaint: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(["faults", *arguments]) == EXIT_USAGE
    assert complaint in capfd.readouterr().err


def test_a_campaign_that_is_stopped_tells_what_was_done(
    made_up: set[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    made_up |= {1, 2}
    try_seed = campaign.try_seed

    def stopped(seed: int, mutant: str = "", values: Sequence[str] = ()) -> Outcome:
        if seed == 3:
            raise KeyboardInterrupt
        return try_seed(seed, mutant, values)

    monkeypatch.setattr(campaign, "try_seed", stopped)
    kept, table = tmp_path / "kept.jsonl", tmp_path / "table.md"
    arguments = [
        "faults",
        "--jobs",
        "1",
        "--first-seed",
        "0",
        "--seeds",
        "9",
        "--kept",
        str(kept),
        "--table",
        str(table),
    ]
    assert run_command_line(arguments) == EXIT_INTERRUPTED
    out, err = capfd.readouterr()
    assert "violations: 4, in 2 schedules" in out
    assert out.endswith("coheft faults --replay 1\n")
    assert err == (
        f"stopped after 3 of 9 schedules; no table (--table) was written; the same command continues with the outcomes "
        f"in {kept}\n"
    )
    assert run_command_line(["faults", "--jobs", "1", "--first-seed", "3", "--quiet"]) == EXIT_INTERRUPTED
    assert capfd.readouterr() == ("", "stopped after 0 of 100 schedules\n")


def test_each_campaign_has_seeds_of_its_own_and_one_that_goes_on_has_the_same(
    made_up: set[int], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    def first_seed(*options: str) -> int:
        assert run_command_line(["faults", "--seeds", "2", "--jobs", "1", *options]) == EXIT_CONVERGED
        found = re.search(r"^first seed (\d+)$", capfd.readouterr().out, re.MULTILINE)
        assert found is not None
        return int(found[1])

    kept = ["--kept", str(tmp_path / "kept.jsonl")]
    one, other = first_seed(), first_seed()
    assert one != other
    assert first_seed(*kept) == first_seed(*kept) != one
    assert first_seed(*kept, "--first-seed", "7") == 7


def test_schedules_that_fail_are_kept_as_files(made_up: set[int], tmp_path: Path) -> None:
    made_up |= {6, 8}
    arguments = ["faults", "--first-seed", "5", "--seeds", "4", "--jobs", "1", "--quiet"]
    assert run_command_line(arguments) == EXIT_BROKEN_PROMISE
    assert {path.name for path in (tmp_path / "faults-failed").iterdir()} == {"6.json", "8.json"}
    assert read_schedule(tmp_path / "faults-failed" / "6.json") == draw_schedule(6)
    assert run_command_line([*arguments, "--failed", str(tmp_path / "another")]) == EXIT_BROKEN_PROMISE
    assert (tmp_path / "another" / "8.json").exists()
    assert run_command_line([*arguments, "--mutant", MUTANT, "--failed", str(tmp_path / "no")]) == EXIT_BROKEN_PROMISE
    assert not (tmp_path / "no").exists()  # they fail on purpose


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="Ctrl-C as a terminal sends it")
def test_ctrl_c_ends_a_campaign_and_its_workers_at_once(tmp_path: Path) -> None:
    out, err, kept = tmp_path / "out", tmp_path / "err", tmp_path / "kept.jsonl"
    command = [sys.executable, "-m", "coheft", "faults", "--seeds", "1000", "--jobs", "2", "--kept", str(kept)]
    command += ["--first-seed", "102"]  # two short runs
    with out.open("w") as to_out, err.open("w") as to_err:
        process = subprocess.Popen(command, stdout=to_out, stderr=to_err, start_new_session=True)
    try:
        wait_until(lambda: kept.exists() and kept.read_bytes().count(b"\n") > 1, "outcomes")
        os.killpg(process.pid, signal.SIGINT)
        assert process.wait(60.0) == EXIT_INTERRUPTED
        wait_until(lambda: not group(process.pid), "workers to end")
    finally:
        if group(process.pid):
            os.killpg(process.pid, signal.SIGKILL)
    assert re.fullmatch(r"stopped after \d+ of 1000 schedules; the same command continues .*\n", err.read_text())
    assert " schedules, " in out.read_text()


def group(leader: int) -> list[str]:
    """States of the processes in a group that have not ended."""
    listed = subprocess.run(["ps", "-eo", "pgid=,stat="], capture_output=True, text=True, check=True).stdout
    lines = [line.split() for line in listed.splitlines()]
    return [state for pgid, state in lines if int(pgid) == leader and not state.startswith("Z")]


def test_the_summary_goes_to_standard_output_and_all_else_does_not(
    made_up: set[int], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    made_up |= {1}
    table = tmp_path / "table.md"
    arguments = ["faults", "--seeds", "3", "--first-seed", "0", "--jobs", "1", "--json", "-", "--table", str(table)]
    assert run_command_line(arguments) == EXIT_BROKEN_PROMISE
    out, err = capfd.readouterr()
    summary = json.loads(out)
    assert (summary["schedules"], summary["violations"], summary["failed"]) == (3, 2, [1])
    assert err.splitlines()[-1] == "coheft faults --replay 1"
    head, *rows = table.read_text().splitlines()
    assert head == "3 schedules (seeds 0 to 2), 0.0 simulated hours: 2 violations."
    assert rows[-1] == "| lie (scaled) | 3 | 3 of 3 | 2 | 0, 0 | 0.50 s | 0.95 s | 1.00 s |"


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_what_a_campaign_finds_is_shown_again_by_its_last_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    report, table = tmp_path / "summary.json", tmp_path / "table.md"
    arguments = [
        "faults",
        "--seeds",
        "1",
        "--first-seed",
        "332",
        "--mutant",
        MUTANT,
        "--jobs",
        "1",
        "--json",
        str(report),
    ]
    assert run_command_line([*arguments, "--table", str(table)]) == EXIT_BROKEN_PROMISE
    last = capfd.readouterr().out.splitlines()[-1]
    assert last == f"coheft faults --replay 332 --mutant {MUTANT}"
    assert json.loads(report.read_bytes())["failed"] == [332]
    assert "\n| crash | 1 | " in table.read_text()

    assert run_command_line(shlex.split(last)[1:]) == EXIT_BROKEN_PROMISE
    out = capfd.readouterr().out
    assert out.startswith("seed 332: ")
    assert "crash: robot " in out
    assert "P3 at " in out


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_schedule_that_was_simplified_breaks_the_promise_still(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """The loss has nothing to do with it."""
    monkeypatch.chdir(tmp_path)
    drawn = plain(0)
    perimeter = drawn.scenario.robots.perimeter
    assert perimeter is not None
    three = _replace(drawn.scenario.robots, perimeter=_replace(perimeter, count=3))
    scenario = _replace(drawn.scenario, robots=three, graph=Graph(kind="ring"), lookahead=1, load_changes=())
    schedule = _replace(drawn, scenario=scenario, faults=(Loss(start=0.0, end=0.1, probability=0.5),))
    scenario = _replace(scenario, duration=latest_recovery(schedule) + scenario.block_duration)
    write_schedule(_replace(schedule, scenario=scenario), Path("drawn.json"))
    replay = ["faults", "--replay"]
    Path("faults-0.json").write_text("what was found before")
    assert run_command_line([*replay, "drawn.json", "--mutant", MUTANT, "--shrink"]) == EXIT_BROKEN_PROMISE
    assert "written to faults-0-2.json" in capfd.readouterr().out
    assert Path("faults-0.json").read_text() == "what was found before"
    assert read_schedule(Path("faults-0-2.json")).faults == ()
    assert run_command_line([*replay, "faults-0-2.json", "--mutant", MUTANT, "--shrink"]) == EXIT_BROKEN_PROMISE
    out = capfd.readouterr().out
    assert out.startswith("the schedule cannot be simplified: anything simpler keeps these promises\nseed 0: ")
    assert "written to" not in out
    # Nothing goes wrong in it any more: agents without the bug keep all promises.
    assert run_command_line([*replay, "faults-0-2.json", "--shrink"]) == EXIT_CONVERGED
    out = capfd.readouterr().out
    assert out.startswith("the schedule breaks no promise, so there is nothing to simplify\n")
    assert "violations: 0" in out

"""The campaign that redoes the paper on mocobots: one experiment, and the tables."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from coheft.app.cli.base import EXIT_CONVERGED, EXIT_USAGE
from coheft.app.cli.main import run_command_line
from coheft.app.mocobots.campaign import PAPER, ROWS, Mocobots, Trial, scenario_of
from coheft.app.mocobots.tables import markdown, print_tables, typical, worse_than_paper


def trials(factor: float, configuration: str = "a") -> list[Trial]:
    """Two experiments by every method, that many times as wrong as the paper; inertias off to both sides."""
    rows = factor * np.array(PAPER[configuration])
    signs = np.array([1.0] * 8 + [-1.0] * 3)
    return [
        Trial(configuration, noise, method, number, (rows * (signs if number == 2 else 1.0)).tolist())
        for noise, methods in (("vibration", ("batch", "instruments", "pose")), ("calibration", ("batch", "pose")))
        for method in methods
        for number in (1, 2)
    ]  # type: ignore[misc]


def test_rows_are_compared_in_the_papers_own_terms() -> None:
    for factor, worse in ((0.99, 0), (1.01, len(ROWS))):
        found = Mocobots(trials(factor), 2)
        assert len(worse_than_paper(found, "calibration", "pose")) == worse
    assert typical(np.array([3.0, -3.0]), 10) == pytest.approx(3.0)
    assert PAPER["c"][8] == pytest.approx(np.hypot(0.3, 4.0))


def test_tables_hold_every_row_of_every_configuration() -> None:
    text = markdown(Mocobots([*trials(0.5), *trials(0.5, "d")], 2))
    assert text.count("### Table") == 4
    # Half of the paper's largest position error.
    short = next(line for line in text.splitlines() if line.startswith("| pose, vibration |"))
    assert short.split("|")[3].strip().endswith("(28.50)")
    assert text.count("\n| a, ") == text.count("\n| d, ") == len(ROWS)
    row = next(line for line in text.splitlines() if line.startswith("| a, position 31"))
    assert row.split("|")[2].strip() == "51"
    assert "25.50 (25.50)" in row


def test_tables_of_the_terminal_fit_into_80_columns() -> None:
    console = Console(record=True, width=80, force_terminal=True, file=io.StringIO())
    print_tables(console, Mocobots([*trials(0.5), *trials(0.5, "d")], 2))
    text = console.export_text()
    assert "|" not in text
    row = next(line for line in text.splitlines() if line.startswith("a, position 31"))
    assert row.split()[3:] == ["51", *["26"] * 5]


def test_experiments_differ_and_robots_stay_the_same() -> None:
    one, other = scenario_of("a", "calibration", 1), scenario_of("b", "calibration", 1)
    assert one.seed != other.seed
    encoders, others = one.sensors.encoders, other.sensors.encoders
    assert encoders is not None
    assert others is not None
    assert encoders == others
    assert encoders.misalignment_deg == 1.0
    plain = scenario_of("a", "vibration", 1).sensors.encoders
    assert plain is not None
    assert (plain.misalignment_deg, plain.force_offset, plain.vibration_deg) == (0.0, 0.0, 0.035)


@pytest.mark.slow
def test_one_experiment_of_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("joblib")
    report, tables = tmp_path / "m.json", tmp_path / "m.md"
    arguments = ["mocobots", "--experiments", "1", "--configurations", "b", "--jobs", "1", "--quiet"]
    assert run_command_line([*arguments, "--json", str(report), "--markdown", str(tables)]) == EXIT_CONVERGED
    assert capsys.readouterr().out == ""
    told = json.loads(report.read_text())["trials"]
    assert {(trial["noise"], trial["method"]) for trial in told} == {
        ("vibration", "batch"),
        ("vibration", "instruments"),
        ("vibration", "pose"),
        ("calibration", "batch"),
        ("calibration", "pose"),
    }
    assert all(len(trial["rows"]) == len(ROWS) for trial in told)
    assert tables.read_text().count("\n| b, ") == len(ROWS)


def test_other_configurations_are_refused() -> None:
    assert run_command_line(["mocobots", "--configurations", "ax"]) == EXIT_USAGE
